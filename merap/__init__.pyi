from .checker.verdicts import verify as verify
from .concerns.case_study import CaseStudy as CaseStudy
from .concerns.case_study import load_case as load_case
from .errors import MerapError as MerapError
from .families.build import build_base as build_base
from .learning.running import train as train
from .mapek.run import run_loop as run_loop
from .mdp.model import TabularMDP as TabularMDP
from .prism.rendering import render as render
from .strategies.adaptation import adapt as adapt

__all__: list[str]
