from .checkpoint import read_policy as read_policy
from .config import TrainingConfig as TrainingConfig
from .meta import MetaPolicy as MetaPolicy
from .models import train_models as train_models
from .policy_export import npz_bytes as npz_bytes
from .policy_export import prism_text as prism_text
from .policy_export import tabulate as tabulate
from .run_folder import RunFolder as RunFolder
from .run_folder import read_run as read_run
from .run_folder import read_tasks as read_tasks
from .running import resume as resume
from .running import tasks_of as tasks_of
from .tasks import task_batch as task_batch
from .transfer import carried_over as carried_over

__all__: list[str]
