from .base import KnowledgeBase as KnowledgeBase
from .base import open_knowledge as open_knowledge
from .engine import default_url as default_url
from .event_log import EventLog as EventLog
from .event_log import JsonLines as JsonLines
from .export import export_run as export_run
from .replay import DecisionDifference as DecisionDifference
from .replay import timeline as timeline
from .rows import DecisionRow as DecisionRow
from .rows import EventRow as EventRow
from .rows import ObservationRow as ObservationRow
from .rows import RunRow as RunRow

__all__: list[str]
