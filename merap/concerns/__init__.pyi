from .case_study import CaseStudy as CaseStudy
from .combination import Combination as Combination

__all__: list[str]
