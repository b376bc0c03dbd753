from .run import run_loop as run_loop
from .scenario import Scenario as Scenario
from .scenario import read_scenario as read_scenario
from .scores import LoopReport as LoopReport
from .serving import served_combination as served_combination
from .serving import served_scenario as served_scenario

__all__: list[str]
