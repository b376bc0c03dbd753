from .case_study import CaseStudy as CaseStudy
from .case_study import load_case as load_case
from .combination import Combination as Combination

__all__: list[str]
