from .checker.checking import check as check
from .concerns.case_study import CaseStudy as CaseStudy
from .errors import MerapError as MerapError
from .errors import MerapWarning as MerapWarning
from .families.build import build_base as build_base
from .families.loading import load_case as load_case
from .families.verification import verify as verify
from .learning.config import TrainingConfig as TrainingConfig
from .mapek.run import run_loop as run_loop
from .mapek.scenario import read_scenario as read_scenario
from .mdp.model import TabularMDP as TabularMDP
from .prism.rendering import render as render
from .runs.run_folder import RunFolder as RunFolder
from .runs.run_folder import read_run as read_run
from .runs.train import resume as resume
from .runs.train import train as train
from .shield.learning_shield import ShieldSettings as ShieldSettings
from .strategies.adaptation import adapt as adapt
from .strategies.problem import Conditions as Conditions

__all__: list[str]
__version__: str
