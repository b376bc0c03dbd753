from .space import HypothesisSpace as HypothesisSpace
from .space import hypothesis_space as hypothesis_space
from .strategy import BeliefStrategy as BeliefStrategy

__all__: list[str]
