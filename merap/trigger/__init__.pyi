from .change import ChangeTrigger as ChangeTrigger
from .readings import Forecast as Forecast
from .settings import ChangeSettings as ChangeSettings

__all__: list[str]
