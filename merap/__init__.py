"""merap: meta-reinforcement-learning adaptive planning over checked Markov decision processes.

The names below are the public interface; they are imported when first used, so that looking at
a case does not wait for torch.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from merap.base.build import build_base
    from merap.checker.verdicts import verify
    from merap.concerns.case_study import CaseStudy, load_case
    from merap.errors import MerapError
    from merap.learning.running import train
    from merap.mdp.model import TabularMDP
    from merap.online.adaptation import adapt
    from merap.online.loop.running import run_loop
    from merap.prism.rendering import render

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
    "adapt": "merap.online.adaptation",
    "build_base": "merap.base.build",
    "load_case": "merap.concerns.case_study",
    "render": "merap.prism.rendering",
    "run_loop": "merap.online.loop.running",
    "train": "merap.learning.running",
    "verify": "merap.checker.verdicts",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'merap' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
