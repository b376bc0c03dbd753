"""A case's model base: every task as arrays on one index, from what Storm built and checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from merap.checker.building import build_combination, build_pair
from merap.concerns.case_study import CaseStudy
from merap.concerns.combination import Combination
from merap.concerns.synthesis import attach, pair_valuations, synthesise, synthesise_pair
from merap.mdp.canonical import canonicalise
from merap.mdp.comparison import compare
from merap.mdp.model import Bools, TabularMDP
from merap.mdp.reserved_names import MODE_VARIABLE

MAX_TASKS = 512
MAX_PAIRS = 128
COMPARED = 16


@dataclass(frozen=True, eq=False)
class ModelBase:
    """The tasks to learn from (the paper's N_M), all on the canonical index of their case.

    Attributes:
        case: name of the case.
        digest: hexadecimal SHA-256 of its sources.
        names: of the N tasks.
        models: N canonical models with equal states, actions and variables.
        horizon: steps of an episode.
        discount: of a step.
        covered: how many combinations the case has; N of them are here.
        compared: how many models Storm has built and found equal to the definition.
    """

    case: str
    digest: str
    names: tuple[str, ...]
    models: tuple[TabularMDP, ...]
    horizon: int
    discount: float
    covered: int
    compared: int


def build_base(case: CaseStudy, *, max_tasks: int = MAX_TASKS, seed: int = 0) -> ModelBase:
    """Build the tasks of a case.

    Up to `max_tasks` combinations are all there; of more, that many are drawn. Storm builds
    every pair of environment and capability once and objectives are attached to its arrays. Of
    more than `MAX_PAIRS` pairs the models come from the definition, and a random
    `COMPARED` of them are built by Storm from their whole text and compared.

    Args:
        case: the case.
        max_tasks: largest number of tasks.
        seed: of what is drawn.

    Raises:
        InputError: a reachable state has no action.
        ModelError: a model is unsound, or Storm and the definition differ.
        EngineError: Storm failed.
    """
    generator = np.random.default_rng(seed)
    everything = case.size <= max_tasks
    tasks = list(case.combinations()) if everything else case.sample(max_tasks, generator)
    groups = [list(group) for _, group in groupby(tasks, key=_pair)]
    if len(groups) <= MAX_PAIRS:
        models = [model for group in groups for model in _built_by_storm(group)]
        compared = len(models)
    else:
        models = [canonical(task, synthesise(task)) for task in tasks]
        compared = min(COMPARED, len(tasks))
        for index in generator.choice(len(tasks), compared, replace=False):
            compare(models[index], model_of(tasks[index])).require_same()
    return ModelBase(
        case=case.name,
        digest=case.digest,
        names=tuple(task.name for task in tasks),
        models=tuple(models),
        horizon=tasks[0].objective.horizon,
        discount=case.discount,
        covered=case.size,
        compared=compared,
    )


def model_of(combination: Combination) -> TabularMDP:
    """The canonical model of one combination or online system, built by Storm from its whole text."""
    return canonical(combination, build_combination(combination).mdp)


def canonical(combination: Combination, whole: TabularMDP) -> TabularMDP:
    """A whole model on the canonical index of its case."""
    variables = (*combination.space.variable_names, MODE_VARIABLE)
    return canonicalise(whole, pair_valuations(combination), variables, combination.actions)


def _pair(combination: Combination) -> tuple[str, str]:
    return combination.environment.name, combination.capability.name


def _built_by_storm(group: Sequence[Combination]) -> list[TabularMDP]:
    """Models of one environment and capability: one build, one attachment for each objective."""
    starts: Bools = np.any([task.objective.start > 0 for task in group], axis=0)
    pair = build_pair(group[0], starts)
    compare(pair, synthesise_pair(group[0], starts)).require_same()
    return [canonical(task, attach(pair, task)) for task in group]
