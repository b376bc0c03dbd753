"""Evaluate an adaptation: the value of its policies on the true model, and how soon one was good enough.

Axes: T steps, S states, A declared actions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from merap.errors import ModelError
from merap.mdp.evaluation import expected_return
from merap.mdp.model import Floats, TabularMDP
from merap.mdp.planning import optimum, worst_value
from merap.mdp.reserved_names import COMPLETE_LABEL
from merap.mdp.short_repr import ShortRepr

WITHIN = 0.05
SOLVED = 0.02
IN_A_ROW = 3
# Values are exact up to that part of what is at stake; an optimum of 0 is reached at -1e-12.
ROUNDING = 1e-9
QUANTILES = (50, 95)
Evaluator = Callable[[Floats], float]


@dataclass(frozen=True)
class Row:
    """The state of an adaptation after a policy update; row 0 is before any episode.

    Attributes:
        step: number of policy updates so far.
        episodes: number of real episodes so far.
        expected_return: exact undiscounted value, on the true model over its horizon, of the
            policy that would act if learning stopped now.
        sampled_return: mean undiscounted return of the episodes of this step; None in row 0.
    """

    step: int
    episodes: int
    expected_return: float
    sampled_return: float | None


@dataclass(frozen=True)
class Range:
    """Undiscounted returns of the best and the worst time-indexed policy on a model."""

    optimum: float
    worst: float

    @property
    def nothing_at_stake(self) -> bool:
        """Whether all policies earn the same, up to rounding."""
        return self.optimum - self.worst <= self._rounding

    def within_5_percent(self, value: float) -> bool:
        """Return whether optimum - value <= 0.05 |optimum|, up to rounding."""
        return self.optimum - value <= WITHIN * abs(self.optimum) + self._rounding

    def solved(self, value: float) -> bool:
        """Return whether optimum - value <= 0.02 (optimum - worst), up to rounding."""
        return self.optimum - value <= SOLVED * (self.optimum - self.worst) + self._rounding

    @property
    def _rounding(self) -> float:
        return ROUNDING * max(self.optimum - self.worst, abs(self.optimum))


def reachable_range(model: TabularMDP, horizon: int) -> Range:
    """Return the range of what time-indexed policies can earn on a model."""
    return Range(optimum(model, horizon), worst_value(model, horizon))


def evaluator(model: TabularMDP, horizon: int) -> Evaluator:
    """Return a function from a strategy's policy to its exact undiscounted value on the true model.

    Args:
        model: the true one, canonical.
        horizon: T.
    """
    return lambda policy: expected_return(model, executed(model, policy), horizon)


def executed(model: TabularMDP, policy: Floats) -> Floats:
    """Return a strategy's policy as the system carries it out.

    Args:
        model: canonical: its last action is `end`.
        policy: float64 [..., S, A], over declared actions.

    Returns:
        float64 [..., S, A + 1]: zero where an action is disabled, the rest in proportion,
        uniform where nothing is left; `end` in completed states.

    Raises:
        ModelError: the policy has another shape, or a negative or undefined entry.
    """
    if policy.shape[-2:] != (model.num_states, model.num_actions - 1):
        expected = (model.num_states, model.num_actions - 1)
        raise ModelError(f"the policy has shape {policy.shape}, not (.., {expected[0]}, {expected[1]})")
    if not np.all(policy >= 0):
        raise ModelError("the policy has a probability that is negative or undefined")
    widened = np.concatenate([policy, np.zeros((*policy.shape[:-1], 1))], axis=-1) * model.enabled
    nothing_left = widened.sum(axis=-1, keepdims=True) == 0
    widened = np.where(nothing_left, model.enabled * 1.0, widened)
    widened[..., model.labels[COMPLETE_LABEL], -1] = 1.0
    shares: Floats = widened / np.maximum(widened.sum(axis=-1, keepdims=True), 1e-300)
    return shares


@dataclass(frozen=True, repr=False)
class Run(ShortRepr):
    """One adaptation.

    Attributes:
        seed: seed of its episodes.
        curve: a row for each policy update and row 0.
        steps_to_within_5_percent: steps of the first of three rows in a row that are; None if never.
        episodes_to_within_5_percent: likewise.
        episodes_to_solved: episodes of the first of three rows in a row that are solved; None if never.
        first_episode_regret: optimum minus the value of the policy before any episode.
        cumulative_regret: optimum minus the value of the policy in use, summed over the real
            episodes, or the first of them; exploration is not in it.
        sampled_regret: optimum minus what the same episodes returned, summed: with exploration,
            and with luck.
        steps_back: steps that the system took to get back to its start between episodes.
        too_short: it never was within 5 % for three rows in a row, but might have been had it gone on: its
            last row is, or there are fewer than three.
    """

    seed: int
    curve: tuple[Row, ...]
    steps_to_within_5_percent: int | None
    episodes_to_within_5_percent: int | None
    episodes_to_solved: int | None
    first_episode_regret: float
    cumulative_regret: float
    sampled_regret: float
    steps_back: int
    too_short: bool


def judged(
    seed: int,
    curve: Sequence[Row],
    reachable: Range,
    steps_back: int = 0,
    regret_episodes: int | None = None,
) -> Run:
    """Return a run with its scores.

    Args:
        seed: seed of its episodes.
        curve: row 0 and a row for each policy update.
        reachable: range of returns that policies can earn.
        steps_back: steps that the system took to get back to its start between episodes.
        regret_episodes: regret is summed over that many real episodes from the first on; None: over all.
    """
    good = [reachable.within_5_percent(row.expected_return) for row in curve]
    near = lasting(good)
    solved = lasting([reachable.solved(row.expected_return) for row in curve])
    last = math.inf if regret_episodes is None else regret_episodes
    counted = [
        (min(now.episodes, last) - min(before.episodes, last), before, now) for before, now in pairwise(curve)
    ]
    return Run(
        seed=seed,
        curve=tuple(curve),
        steps_to_within_5_percent=None if near is None else curve[near].step,
        episodes_to_within_5_percent=None if near is None else curve[near].episodes,
        episodes_to_solved=None if solved is None else curve[solved].episodes,
        first_episode_regret=reachable.optimum - curve[0].expected_return,
        cumulative_regret=sum(
            episodes * (reachable.optimum - before.expected_return) for episodes, before, _ in counted
        ),
        sampled_regret=sum(
            episodes * (reachable.optimum - now.sampled_return)
            for episodes, _, now in counted
            if now.sampled_return is not None
        ),
        steps_back=steps_back,
        too_short=near is None and (good[-1] or len(good) < IN_A_ROW),
    )


def lasting(good: Sequence[bool]) -> int | None:
    """Return the index of the first of three good rows in a row; None if there is none."""
    windows = (all(good[index : index + IN_A_ROW]) for index in range(len(good) - IN_A_ROW + 1))
    return next((index for index, lasting in enumerate(windows) if lasting), None)


def summary(runs: Sequence[Run]) -> dict[str, Any]:
    """Return figures over runs.

    Means, medians and maxima of steps and episodes are of the runs that got there, `never` counts
    the others, `too_short` those of them that ended before it could be told. Quantiles are over all
    runs, where one that never got there counts as longer than any; they are None where they fall on
    one of those.
    """
    steps = [run.steps_to_within_5_percent for run in runs]
    episodes = [run.episodes_to_within_5_percent for run in runs]
    solved = [run.episodes_to_solved for run in runs]
    return {
        "runs": len(runs),
        "too_short": sum(run.too_short for run in runs),
        **_statistics("steps_to_within_5_percent", steps),
        **_statistics("episodes_to_within_5_percent", episodes),
        **_quantiles("episodes_to_within_5_percent", episodes),
        **_statistics("episodes_to_solved", solved),
        "mean_initial_return": float(np.mean([run.curve[0].expected_return for run in runs])),
        "mean_final_return": float(np.mean([run.curve[-1].expected_return for run in runs])),
        "min_final_return": float(np.min([run.curve[-1].expected_return for run in runs])),
        **_regrets("first_episode_regret", [run.first_episode_regret for run in runs]),
        **_regrets("cumulative_regret", [run.cumulative_regret for run in runs]),
        **_regrets("sampled_regret", [run.sampled_regret for run in runs]),
    }


def _statistics(name: str, values: Sequence[int | None]) -> dict[str, Any]:
    reached = [value for value in values if value is not None]
    return {
        f"mean_{name}": float(np.mean(reached)) if reached else None,
        f"median_{name}": float(np.median(reached)) if reached else None,
        f"max_{name}": max(reached, default=None),
        f"never_{name}": len(values) - len(reached),
    }


def _quantiles(name: str, values: Sequence[int | None]) -> dict[str, Any]:
    """Return the least values that half, and 95 percent, of the runs do not exceed."""
    ranked = sorted(math.inf if value is None else value for value in values)
    found = {percent: ranked[math.ceil(percent * len(ranked) / 100) - 1] for percent in QUANTILES}
    return {
        f"quantile_{percent}_{name}": None if value == math.inf else value for percent, value in found.items()
    }


def _regrets(name: str, values: Sequence[float]) -> dict[str, float]:
    return {f"mean_{name}": float(np.mean(values)), f"max_{name}": float(np.max(values))}


def as_dict(run: Run) -> dict[str, Any]:
    """Return the run as JSON has it."""
    return asdict(run)
