from .adaptation import Adaptation as Adaptation
from .adaptation import adapt as adapt
from .adaptation import adapt_to as adapt_to
from .evaluation import evaluator as evaluator
from .gradient import GradientStrategy as GradientStrategy
from .problem import AdaptationProblem as AdaptationProblem
from .problem import Conditions as Conditions
from .problem import adaptation_problem as adaptation_problem
from .protocol import adaptation_rows as adaptation_rows
from .protocol import episode as episode
from .training_result import TrainingResult as TrainingResult
from .training_result import evaluate_training as evaluate_training

__all__: list[str]
