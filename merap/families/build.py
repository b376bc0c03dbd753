"""A case's model base: every task as arrays on one index, from what Storm built and checked."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from os import PathLike

import numpy as np

from merap.checker.combination_model import build_combination, build_pair
from merap.concerns.arguments import as_count
from merap.concerns.case_study import CaseStudy
from merap.concerns.combination import Combination
from merap.concerns.synthesis import attach, pair_valuations, synthesise, synthesise_pair
from merap.families.lookup import as_case
from merap.mdp.canonical import canonicalise
from merap.mdp.comparison import compare
from merap.mdp.graph import fewest_steps
from merap.mdp.model import Bools, TabularMDP
from merap.mdp.reserved_names import GOAL_LABEL, MODE_VARIABLE
from merap.mdp.short_repr import ShortRepr
from merap.program.labels import may_hold

MAX_TASKS = 512
MAX_PAIRS = 128
COMPARED = 16


@dataclass(frozen=True, eq=False, repr=False)
class ModelBase(ShortRepr):
    """The tasks to learn from (the paper's N_M), all on the canonical index of their case.

    Attributes:
        case: name of the case.
        digest: hexadecimal SHA-256 of its sources.
        names: names of the N tasks.
        models: N canonical models with equal states, actions and variables.
        horizon: steps of an episode.
        discount: discount of a step.
        covered: how many combinations the case has; N of them are here.
        compared: how many models Storm has built and found equal to the definition.
        cut_off: names of the tasks that can't reach their goal within the horizon.
    """

    case: str
    digest: str
    names: tuple[str, ...]
    models: tuple[TabularMDP, ...]
    horizon: int
    discount: float
    covered: int
    compared: int
    cut_off: tuple[str, ...] = ()


def build_base(
    case: CaseStudy | str | PathLike[str],
    *,
    max_tasks: int = MAX_TASKS,
    seed: int = 0,
    on_model: Callable[[], None] = lambda: None,
) -> ModelBase:
    """Build the tasks of a case.

    Up to `max_tasks` combinations are all built; from more, that many are drawn. Storm builds
    every pair of environment and capability once and objectives are attached to its arrays. Beyond
    `MAX_PAIRS` pairs the models come from the definition, and a random `COMPARED` of them
    are built by Storm from their whole text and compared.

    Args:
        case: the case, or its path.
        max_tasks: largest number of tasks.
        seed: seed of the draws.
        on_model: called after each model.

    Raises:
        InputError: a reachable state has no action.
        ModelError: a model is unsound, or Storm and the definition differ.
        EngineError: Storm failed.
    """
    case = as_case(case)
    generator = np.random.default_rng(as_count(seed, "seed", least=0))
    everything = case.size <= as_count(max_tasks, "max_tasks")
    tasks = list(case.combinations()) if everything else case.sample(max_tasks, generator)
    groups = [list(group) for _, group in groupby(tasks, key=_pair)]
    wholes: Iterable[TabularMDP]
    if len(groups) <= MAX_PAIRS:
        wholes = (whole for group in groups for whole in _built_by_storm(group))
        compared = len(tasks)
    else:
        wholes = map(synthesise, tasks)
        compared = min(COMPARED, len(tasks))
    models, cut_off = [], []
    for task, whole in zip(tasks, wholes, strict=True):
        models.append(canonical(task, whole))
        if is_cut_off(task, whole):
            cut_off.append(task.name)
        on_model()
    if len(groups) > MAX_PAIRS:
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
        cut_off=tuple(cut_off),
    )


def model_of(combination: Combination) -> TabularMDP:
    """Return the canonical model of one combination or online system, built by Storm from its whole text."""
    return canonical(combination, build_combination(combination).mdp)


def canonical(combination: Combination, whole: TabularMDP) -> TabularMDP:
    """Put a whole model on the canonical index of its case."""
    variables = (*combination.space.variable_names, MODE_VARIABLE)
    return canonicalise(whole, pair_valuations(combination), variables, combination.actions)


def _pair(combination: Combination) -> tuple[str, str]:
    return combination.environment.name, combination.capability.name


def is_cut_off(combination: Combination, whole: TabularMDP) -> bool:
    """Return whether a combination has a goal and no path to it within its horizon.

    Args:
        combination: `whole` is its model, before it is put on the canonical index.
        whole: with the label `goal`.
    """
    declared = may_hold(combination.program, GOAL_LABEL)
    return declared and fewest_steps(whole, whole.labels[GOAL_LABEL]) > combination.objective.horizon


def cut_off_warnings(system: Combination) -> tuple[str, ...]:
    """Return a sentence that says so if a system can't reach its goal within its horizon."""
    if not is_cut_off(system, synthesise(system)):
        return ()
    return (f"{system.name} can't reach its goal within {system.objective.horizon} steps",)


def _built_by_storm(group: Sequence[Combination]) -> list[TabularMDP]:
    """Return whole models of one environment and capability: one build, one attachment for each objective."""
    starts: Bools = np.any([task.objective.start > 0 for task in group], axis=0)
    pair = build_pair(group[0], starts)
    compare(pair, synthesise_pair(group[0], starts)).require_same()
    return [attach(pair, task) for task in group]
