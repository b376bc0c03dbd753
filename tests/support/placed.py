"""Models on an index of their own, for tests that need no case."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from merap.belief.space import HypothesisSpace
from merap.concerns.combination import Combination
from merap.families.build import ModelBase
from merap.families.index import family_index, index_kinds
from merap.families.models import explored
from merap.families.observation import model_kinds
from merap.mdp.index import FamilyIndex, new_index
from merap.mdp.index import index_of as index_of_model
from merap.mdp.model import Ints, TabularMDP


def placed(
    whole: TabularMDP, valuations: Ints, variable_names: tuple[str, ...], actions: tuple[str, ...]
) -> TabularMDP:
    """Put a model on an index of some states, behind the completed states that it has."""
    completed = new_index(variable_names, actions).extended(whole).completed
    return new_index(variable_names, actions, valuations, completed).place(whole)


def index_of(combinations: Sequence[Combination]) -> FamilyIndex:
    """The index of some combinations of one case."""
    kinds = index_kinds([one.program for one in combinations])
    return family_index(kinds, combinations[0].actions, [explored(one) for one in combinations])


def model_of(combination: Combination, index: FamilyIndex | None = None) -> TabularMDP:
    """Explore a combination and put it on an index; None: on its own."""
    whole = explored(combination)
    return (index_of([combination]) if index is None else index.extended(whole)).place(whole)


def models_of(combinations: Sequence[Combination]) -> list[TabularMDP]:
    """Explore combinations of one case and put them on one index."""
    index = index_of(combinations)
    return [index.place(explored(one)) for one in combinations]


def base_of(models: Sequence[TabularMDP], horizon: int, discount: float) -> ModelBase:
    """A base of models that are on one index."""
    return ModelBase(
        case="made by hand",
        digest="",
        names=tuple(f"case{number}" for number in range(len(models))),
        index=index_of_model(models[0]),
        kinds=model_kinds(models[0]),
        models=tuple(models),
        horizons=(horizon,) * len(models),
        discount=discount,
        covered=len(models),
        compared=0,
    )


def as_believed(space: HypothesisSpace, whole: TabularMDP) -> TabularMDP:
    """Put a whole model on the states of a belief, which has one completed state."""
    labels = {name: mask & ~whole.labels["done"] for name, mask in whole.labels.items() if name != "done"}
    return space.states.place(replace(whole, labels={**labels, "done": whole.labels["done"]}))


def told_by_done(whole: TabularMDP) -> TabularMDP:
    """Put a whole model with a flag on an index of its own, with one completed state and no other label."""
    alike = replace(whole, labels={"done": whole.labels["done"]})
    names = tuple(name for name in whole.variable_names if name != "done")
    actions = tuple(name for name in whole.action_names if name != "end")
    return new_index(names, actions).extended(alike).place(alike)
