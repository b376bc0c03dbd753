"""merap: meta-reinforcement-learning adaptive planning over checked Markov decision processes.

The names below are the public interface; they are imported when first used, so that looking at
a case does not wait for torch.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from merap.checker.verdicts import verify
    from merap.concerns.case_study import CaseStudy, load_case
    from merap.errors import MerapError
    from merap.families.build import build_base
    from merap.learning.running import train
    from merap.mapek.run import run_loop
    from merap.mdp.model import TabularMDP
    from merap.prism.rendering import render
    from merap.strategies.adaptation import adapt

__all__ = [
    "CaseStudy",
    "MerapError",
    "TabularMDP",
    "adapt",
    "build_base",
    "load_case",
    "render",
    "run_loop",
    "train",
    "verify",
]

_HOMES = {
    "CaseStudy": "merap.concerns.case_study",
    "MerapError": "merap.errors",
    "TabularMDP": "merap.mdp.model",
    "adapt": "merap.strategies.adaptation",
    "build_base": "merap.families.build",
    "load_case": "merap.concerns.case_study",
    "render": "merap.prism.rendering",
    "run_loop": "merap.mapek.run",
    "train": "merap.learning.running",
    "verify": "merap.checker.verdicts",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'merap' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
