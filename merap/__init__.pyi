from merap.checker.verdicts import verify as verify
from merap.concerns.case_study import CaseStudy as CaseStudy
from merap.concerns.case_study import load_case as load_case
from merap.errors import MerapError as MerapError
from merap.families.build import build_base as build_base
from merap.learning.running import train as train
from merap.mapek.run import run_loop as run_loop
from merap.mdp.model import TabularMDP as TabularMDP
from merap.prism.rendering import render as render
from merap.strategies.adaptation import adapt as adapt

__all__: list[str]
