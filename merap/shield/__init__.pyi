from .learning_shield import LearningShield as LearningShield
from .learning_shield import ShieldSettings as ShieldSettings

__all__: list[str]
