"""What a shield prevents and what it costs: thousands of exploring episodes with it and without."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from merap.belief.states import belief_states
from merap.concerns.case_study import CaseStudy
from merap.concerns.combination import Combination
from merap.concerns.lookup import declared
from merap.families.models import explored
from merap.mdp.model import TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL
from scripts.bench.shield_exploration import Episodes, Habits, explore

ROBOTS = 500


@dataclass(frozen=True)
class Setting:
    """One system, met by robots that know the models of its objective.

    Attributes:
        case: a path below `models`.
        system: a combination of the case, or an online system whose model is one of the base's.
        threshold: lambda.
    """

    case: str
    system: str
    threshold: float


# A threshold of 0 where a policy can keep it and get to the goal; at `island` it can't (Storm's
# `safely` is 0.9), so that one stands for what happens then, with more allowed beside it.
SETTINGS = (
    Setting("running-example", "c_blocked.speed_high.g1", 0.0),
    Setting("hazard-grid", "met", 0.0),
    Setting("hazard-grid", "met", 0.05),
    Setting("hazard-grid", "island", 0.0),
    Setting("hazard-grid", "island", 0.1),
    Setting("hazard-grid", "island", 0.25),
)


def shield_figures(
    case: CaseStudy, system: str, thresholds: Sequence[float], episodes: int = 10_000, seed: int = 0
) -> Iterator[dict[str, Any]]:
    """Yield a row without a shield, then one for each threshold, all with the same random numbers.

    Args:
        case: the case.
        system: see `Setting`.
        thresholds: lambda.
        episodes: of all robots together, who are `ROBOTS` or, for fewer episodes, as many as those.
        seed: of everything random.
    """
    combination = case.system(system)
    models = [_model(one) for one in _known(case, combination)]
    robots = min(ROBOTS, episodes)
    for threshold in (None, *thresholds):
        begin = time.perf_counter()
        found = explore(
            _model(combination),
            models,
            Habits(threshold),
            robots=robots,
            episodes=max(1, episodes // robots),
            horizon=combination.objective.horizon,
            generator=np.random.default_rng(seed),
        )
        yield {
            "case": case.name,
            "system": system,
            "threshold": threshold,
            **_figures(found),
            "seconds": time.perf_counter() - begin,
        }


def _known(case: CaseStudy, combination: Combination) -> list[Combination]:
    """Return the combinations with the objective of the online system."""
    return [one for one in case.combinations() if one.objective.name == combination.objective.name]


def _model(combination: Combination) -> TabularMDP:
    """Return the model on the states of a belief: labels of complete states are left out."""
    whole = explored(combination)
    going = ~whole.labels[COMPLETE_LABEL]
    labels = {name: mask & going for name, mask in whole.labels.items() if name != COMPLETE_LABEL}
    alike = replace(whole, labels={**labels, COMPLETE_LABEL: whole.labels[COMPLETE_LABEL]})
    return belief_states(declared(combination)).place(alike)


def _figures(found: Episodes) -> dict[str, Any]:
    to_goal = found.episodes_to_goal
    arrived = np.isfinite(to_goal)
    return {
        "episodes": found.violated.size,
        "violations": int(found.violated.sum()),
        "violation_rate": float(found.violated.mean()),
        "violation_limit": found.violation_limit,
        "goal_rate": float(found.completed.mean()),
        "goal_rate_first": float(found.completed[0].mean()),
        "goal_rate_last": float(found.completed[-1].mean()),
        "mean_return": float(found.returns.mean()),
        "mean_return_first": float(found.returns[0].mean()),
        "mean_return_last": float(found.returns[-1].mean()),
        "mean_episodes_to_goal": float(to_goal[arrived].mean()) if arrived.any() else None,
        "robots_never_at_goal": int(np.count_nonzero(~arrived)),
        "fallback_steps": found.fallbacks,
        "beyond_from_start": found.beyond_from_start,
        "credible_models_first": float(found.credible[0]),
        "credible_models_last": float(found.credible[-1]),
    }
