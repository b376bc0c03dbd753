"""The curve of an adaptation, and how soon it was good enough (design, section 8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

WITHIN = 0.05
SOLVED = 0.02
IN_A_ROW = 3


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
    """What any policy can earn on the true model: of the best and worst time-indexed policy."""

    optimum: float
    worst: float

    def within_5_percent(self, value: float) -> bool:
        """Whether optimum - value <= 0.05 |optimum|."""
        return self.optimum - value <= WITHIN * abs(self.optimum)

    def solved(self, value: float) -> bool:
        """Whether optimum - value <= 0.02 (optimum - worst)."""
        return self.optimum - value <= SOLVED * (self.optimum - self.worst)


@dataclass(frozen=True)
class Run:
    """One adaptation.

    Attributes:
        seed: of its episodes.
        curve: a row for each policy update and row 0.
        steps_to_within_5_percent: of the first of three rows in a row that are; None if never.
        episodes_to_within_5_percent: likewise.
        episodes_to_solved: of the first of three rows in a row that are solved; None if never.
    """

    seed: int
    curve: tuple[Row, ...]
    steps_to_within_5_percent: int | None
    episodes_to_within_5_percent: int | None
    episodes_to_solved: int | None


def judged(seed: int, curve: Sequence[Row], reachable: Range) -> Run:
    """A run with its scores."""
    near = lasting([reachable.within_5_percent(row.expected_return) for row in curve])
    solved = lasting([reachable.solved(row.expected_return) for row in curve])
    return Run(
        seed=seed,
        curve=tuple(curve),
        steps_to_within_5_percent=None if near is None else curve[near].step,
        episodes_to_within_5_percent=None if near is None else curve[near].episodes,
        episodes_to_solved=None if solved is None else curve[solved].episodes,
    )


def lasting(good: Sequence[bool]) -> int | None:
    """Index of the first of three good rows in a row."""
    windows = (all(good[index : index + IN_A_ROW]) for index in range(len(good) - IN_A_ROW + 1))
    return next((index for index, lasting in enumerate(windows) if lasting), None)


def summary(runs: Sequence[Run]) -> dict[str, Any]:
    """Figures over runs: means and medians are of the runs that got there, `never` counts the others."""
    return {
        "runs": len(runs),
        **_statistics("steps_to_within_5_percent", [run.steps_to_within_5_percent for run in runs]),
        **_statistics("episodes_to_within_5_percent", [run.episodes_to_within_5_percent for run in runs]),
        **_statistics("episodes_to_solved", [run.episodes_to_solved for run in runs]),
        "mean_initial_return": float(np.mean([run.curve[0].expected_return for run in runs])),
        "mean_final_return": float(np.mean([run.curve[-1].expected_return for run in runs])),
        "min_final_return": float(np.min([run.curve[-1].expected_return for run in runs])),
    }


def _statistics(name: str, values: Sequence[int | None]) -> dict[str, Any]:
    reached = [value for value in values if value is not None]
    return {
        f"mean_{name}": float(np.mean(reached)) if reached else None,
        f"median_{name}": float(np.median(reached)) if reached else None,
        f"max_{name}": max(reached, default=None),
        f"never_{name}": len(values) - len(reached),
    }


def as_dict(run: Run) -> dict[str, Any]:
    """For JSON."""
    return asdict(run)
