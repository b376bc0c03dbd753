from .checkpoint import read_policy as read_policy
from .policy_export import npz_bytes as npz_bytes
from .policy_export import prism_text as prism_text
from .policy_export import tabulate as tabulate
from .run_folder import RunFolder as RunFolder
from .run_folder import read_base as read_base
from .run_folder import read_run as read_run
from .train import resume as resume
from .train import tasks_of as tasks_of

__all__: list[str]
