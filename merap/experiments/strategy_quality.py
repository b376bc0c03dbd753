"""How soon each adaptation strategy gets there, and what it costs until then."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import Any

from merap.experiments.belief_quality import Condition, outside_of
from merap.learning.run_folder import RunFolder
from merap.online.adaptation import Adaptation, adapt_to, spread_of_pretrained
from merap.online.curve import summary
from merap.online.encounter import Conditions, Encounter, encounter
from merap.online.strategies.registry import ALL, PRETRAINED, STRATEGIES

COMPARED = tuple(f"{name}:{ALL}" if name == PRETRAINED else name for name in STRATEGIES)


def strategy_figures(
    run: RunFolder,
    strategies: Sequence[str],
    condition: Condition,
    seeds: Sequence[int],
    max_episodes: int,
    episodes_per_step: int,
) -> Iterator[dict[str, Any]]:
    """A row for each strategy on the system `met` of a run's case; three for `pretrained:all`.

    Args:
        run: a finished training run.
        strategies: their names.
        condition: under which the system is met.
        seeds: of the adaptations.
        max_episodes: real episodes at most.
        episodes_per_step: real episodes of a gradient step.
    """
    conditions = Conditions(condition.noise, condition.slip)
    met = encounter(run, run.case.system("met"), episodes_per_step=episodes_per_step, conditions=conditions)
    for name in strategies:
        began = time.perf_counter()
        found = list(_adaptations(met, name, seeds, max_episodes))
        seconds = (time.perf_counter() - began) / (len(found) * len(seeds))
        for shown, one in found:
            yield {
                "case": run.case.name,
                "condition": condition.name,
                "outside": outside_of(run.case),
                "strategy": shown,
                "played": one.strategy,
                "optimum": one.reachable.optimum,
                "seconds_per_seed": seconds,
                **summary(one.runs),
            }


def _adaptations(
    met: Encounter, name: str, seeds: Sequence[int], max_episodes: int
) -> Iterator[tuple[str, Adaptation]]:
    """The adaptations that a name stands for, each with the name it has in tables."""
    if name != f"{PRETRAINED}:{ALL}":
        yield name, adapt_to(met, name, max_episodes=max_episodes, seeds=seeds)
        return
    spread = spread_of_pretrained(met, max_episodes=max_episodes, seeds=seeds)
    for place, one in zip(("best", "median", "worst"), spread.shown, strict=True):
        yield f"{PRETRAINED}, {place}", one
