from .config import TrainingConfig as TrainingConfig
from .exact import expected_return as expected_return
from .meta import MetaPolicy as MetaPolicy
from .meta import carried_over as carried_over
from .models import train_models as train_models
from .tasks import TaskBatch as TaskBatch
from .tasks import task_batch as task_batch

__all__: list[str]
