"""A case's model base: every task as arrays on one index, from what Storm built and checked."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from os import PathLike

import numpy as np

from merap.concerns.arguments import as_count
from merap.concerns.case_study import CaseStudy
from merap.concerns.combination import Combination
from merap.families.index import family_index, index_kinds
from merap.families.lookup import as_case
from merap.families.models import built, explored
from merap.families.observation import VariableKind
from merap.mdp.comparison import compare
from merap.mdp.graph import fewest_steps
from merap.mdp.index import FamilyIndex
from merap.mdp.model import TabularMDP
from merap.mdp.reserved_names import GOAL_LABEL
from merap.mdp.short_repr import ShortRepr
from merap.program.labels import may_hold

MAX_TASKS = 512
# Members are built by Storm one by one up to so many; of more, `COMPARED` are. It takes about 15 ms for one.
MAX_BUILT = 128
COMPARED = 16


@dataclass(frozen=True, eq=False, repr=False)
class ModelBase(ShortRepr):
    """The tasks to learn from (the paper's N_M), all on one index.

    Attributes:
        case: name of the case.
        digest: hexadecimal SHA-256 of its sources.
        names: names of the N tasks.
        index: numbers of their states and actions.
        kinds: V kinds of the variables of the index.
        models: N models on the index.
        horizons: N numbers of steps of an episode.
        discount: discount of a step.
        covered: how many combinations the case has; N of them are here.
        compared: how many models Storm has built and found equal to our own exploration.
        cut_off: names of the tasks that can't reach their goal within the horizon.
    """

    case: str
    digest: str
    names: tuple[str, ...]
    index: FamilyIndex
    kinds: tuple[VariableKind, ...]
    models: tuple[TabularMDP, ...]
    horizons: tuple[int, ...]
    discount: float
    covered: int
    compared: int
    cut_off: tuple[str, ...] = ()

    def extended(self, *models: TabularMDP) -> ModelBase:
        """Return the base on an index that holds the states of some whole models, too."""
        index = self.index.extended(*models)
        if index.num_states == self.index.num_states:
            return self
        return replace(self, index=index, models=tuple(map(index.place, self.models)))


def build_base(
    case: CaseStudy | str | PathLike[str],
    *,
    max_tasks: int = MAX_TASKS,
    seed: int = 0,
    on_model: Callable[[], None] = lambda: None,
) -> ModelBase:
    """Build the tasks of a case.

    Up to `max_tasks` combinations are all tasks; from more, that many are drawn. Up to `MAX_BUILT` tasks
    Storm builds, each from its whole text, and our own exploration must find the same. Of more, it builds a
    random `COMPARED`, and the others are as they were explored.

    Args:
        case: the case, or its path.
        max_tasks: largest number of tasks.
        seed: seed of the draws.
        on_model: called after each model.

    Raises:
        InputError: the case is wrong.
        ModelError: a model is unsound, or Storm and exploration differ.
        EngineError: Storm failed.
    """
    case = as_case(case)
    generator = np.random.default_rng(as_count(seed, "seed", least=0))
    everything = case.size <= as_count(max_tasks, "max_tasks")
    tasks = list(case.combinations()) if everything else case.sample(max_tasks, generator)
    by_storm: dict[int, TabularMDP] = {}
    wholes, cut_off = [], []
    chosen = _chosen(len(tasks), generator)
    for number, task in enumerate(tasks):
        whole = explored(task)
        if number in chosen:
            by_storm[number] = built(task)
            compare(by_storm[number], whole).require_same()
        wholes.append(whole)
        if is_cut_off(task, whole):
            cut_off.append(task.name)
        on_model()
    kinds = index_kinds(task.program for task in tasks)
    index = family_index(kinds, case.actions, wholes)
    models = list(map(index.place, wholes))
    for number, whole in by_storm.items():
        # Storm has expected rewards; those of single steps are ours
        models[number] = replace(index.place(whole), branch_reward=models[number].branch_reward)
    return ModelBase(
        case=case.name,
        digest=case.digest,
        names=tuple(task.name for task in tasks),
        index=index,
        kinds=kinds,
        models=tuple(models),
        horizons=tuple(task.objective.horizon for task in tasks),
        discount=case.discount,
        covered=case.size,
        compared=len(by_storm),
        cut_off=tuple(cut_off),
    )


def _chosen(count: int, generator: np.random.Generator) -> Collection[int]:
    """Return the numbers of the tasks that Storm builds."""
    if count <= MAX_BUILT:
        return range(count)
    return frozenset(generator.choice(count, COMPARED, replace=False).tolist())


def is_cut_off(combination: Combination, whole: TabularMDP) -> bool:
    """Return whether a combination has a goal and no path to it within its horizon.

    Args:
        combination: `whole` is its model, before it is put on an index.
        whole: with the label `goal`.
    """
    declared = may_hold(combination.program, GOAL_LABEL)
    return declared and fewest_steps(whole, whole.labels[GOAL_LABEL]) > combination.objective.horizon


def cut_off_warnings(system: Combination) -> tuple[str, ...]:
    """Return a sentence that says so if a system can't reach its goal within its horizon."""
    if not is_cut_off(system, explored(system)):
        return ()
    return (f"{system.name} can't reach its goal within {system.objective.horizon} steps",)
