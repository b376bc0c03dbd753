"""Learn on random FrozenLake maps and adapt to some that were not among them: frozen_lake.py [--slippery]."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import gymnasium
import numpy as np
import typer
from gymnasium.envs.toy_text.frozen_lake import generate_random_map

from merap.learning import MetaPolicy, TrainingConfig, train_models
from merap.mdp import import_gymnasium, index_of, optimum
from merap.strategies import GradientStrategy, adaptation_rows, evaluator
from merap.systems import GymnasiumSystem

EPISODES = 35
LEARNED_FROM = range(256)  # seeds of maps


@dataclass(frozen=True)
class Lakes:
    """Random maps; an episode ends in a hole, in the goal, or after the horizon.

    Attributes:
        size: of a side, in cells.
        slippery: a move goes to either side of where it should as often as there.
        horizon: most steps of an episode.
        discount: of training.
        settings: of training, where the defaults are not the best.
    """

    size: int
    slippery: bool
    horizon: int
    discount: float
    settings: Mapping[str, Any]

    def env(self, seed: int) -> gymnasium.Env[Any, Any]:
        """Make the map of a seed."""
        return gymnasium.make(
            "FrozenLake-v1",
            desc=generate_random_map(self.size, seed=seed),
            is_slippery=self.slippery,
            max_episode_steps=self.horizon,
        )


# docs/learning.md says why.
SETTINGS = {"updates": 300, "gae_lambda": 0.5}


def lakes(size: int, *, slippery: bool) -> Lakes:
    """Return the maps to learn from, and how; the horizons of slippery lakes are Gymnasium's own."""
    if not slippery:
        return Lakes(size, slippery, 30, 0.95, SETTINGS)
    return Lakes(size, slippery, 100 if size <= 4 else 200, 0.99, SETTINGS | {"exploration": 0.02})


def curve(kind: Lakes, meta: MetaPolicy, seed: int, steps: int) -> list[float]:
    """Return how likely the goal is reached on the map of a seed, before and after each gradient step."""
    model = import_gymnasium(kind.env(seed))  # to keep the score; the strategy sees reset and step alone
    strategy = GradientStrategy(meta, index_of(model), EPISODES, np.random.default_rng(seed))
    with GymnasiumSystem(kind.env(seed), seed=seed) as system:
        rows = adaptation_rows(system, strategy, evaluator(model, kind.horizon), steps * EPISODES)
        return [row.expected_return for row in rows]


def main(
    slippery: Annotated[bool, typer.Option("--slippery", help="Moves go astray, as in Gymnasium.")] = False,
    size: Annotated[int, typer.Option(min=2, help="Of a map's side.")] = 8,
    updates: Annotated[int | None, typer.Option(min=1, help="Of training.")] = None,
    steps: Annotated[int, typer.Option(min=1, help="Gradient steps on each map that is met.")] = 8,
    met: Annotated[
        int, typer.Option(help="Seed of the first such map; those below 256 are learned from.")
    ] = 1000,
    maps: Annotated[int, typer.Option(min=1, help="Maps that are met, with seeds from there on.")] = 12,
    seed: Annotated[int, typer.Option(min=0, help="Of training.")] = 0,
) -> None:
    """Print how often the goal is reached after each step, on average over the maps that are met."""
    kind = lakes(size, slippery=slippery)
    models = [import_gymnasium(kind.env(number)) for number in LEARNED_FROM]
    chosen = {} if updates is None else {"updates": updates}
    config = TrainingConfig.model_validate({**kind.settings, **chosen, "seed": seed})
    meta = train_models(models, kind.horizon, kind.discount, config)

    unseen = range(met, met + maps)
    best = [optimum(import_gymnasium(kind.env(number)), kind.horizon) for number in unseen]
    print(f"the best policy reaches the goal with probability {np.mean(best):.2f}")
    curves = [curve(kind, meta, number, steps) for number in unseen]
    for step, reached in enumerate(np.mean(curves, axis=0)):
        print(f"after {EPISODES * step:3} episodes: {reached:.2f}")


if __name__ == "__main__":
    typer.run(main)
