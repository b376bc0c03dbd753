from __future__ import annotations

import numpy as np
import pytest

from merap.families.build import COMPARED, build_base
from merap.families.loading import load_case
from merap.families.models import built
from merap.mdp.comparison import compare
from merap.mdp.planning import optimum
from tests.support.paths import MODELS


def test_an_enumerated_base_holds_every_combination_as_storm_built_it() -> None:
    case = load_case(MODELS / "running-example")
    base = build_base(case)
    assert base.names == tuple(combination.name for combination in case.combinations())
    assert base.covered == len(base.models) == base.compared == 18
    for name, model in zip(base.names, base.models, strict=True):
        compare(model, base.index.place(built(case.combination(name)))).require_same()


def test_all_models_of_a_base_share_one_index() -> None:
    base = build_base(load_case(MODELS / "running-example"))
    first = base.models[0]
    for model in base.models:
        assert model.action_names == first.action_names
        assert np.array_equal(model.valuations, first.valuations)


def test_a_large_support_is_drawn_from_and_compared_with_storm() -> None:
    case = load_case(MODELS / "paper-grid" / "rq1-4.yaml")
    base = build_base(case, max_tasks=200, seed=3)
    # 1001 environments, 3 capabilities, 9 goals: shared/paper, RQ1-4
    assert base.covered == 27_027
    assert len(set(base.names)) == len(base.models) == 200
    assert base.compared == COMPARED
    for name, model in list(zip(base.names, base.models, strict=True))[:5]:
        compare(model, base.index.place(built(case.combination(name)))).require_same()


def test_what_is_drawn_depends_on_the_seed_alone() -> None:
    case = load_case(MODELS / "paper-grid" / "rq1-4.yaml")
    names = [build_base(case, max_tasks=20, seed=seed).names for seed in (1, 1, 2)]
    assert names[0] == names[1] != names[2]


@pytest.mark.parametrize(
    ("number", "value"),
    # 10 - 0.5 d with d the shortest path to the goal: the paper's world, shared by its authors
    list(enumerate([6, 6, 6, 6, 8, 5, 6, 8], start=1)),
)
def test_optimum_of_what_is_met_in_the_papers_cases(number: int, value: float) -> None:
    case = load_case(MODELS / "paper-grid" / f"rq1-{number}.yaml")
    met = case.system("met")
    assert optimum(built(met), met.objective.horizon) == pytest.approx(value, abs=1e-9)
