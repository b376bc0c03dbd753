"""Learn on random FrozenLake maps and adapt to one that was not among them: frozen_lake.py [--updates n]."""

from __future__ import annotations

from typing import Annotated, Any

import gymnasium
import numpy as np
import typer
from gymnasium.envs.toy_text.frozen_lake import generate_random_map

from merap.learning.config import TrainingConfig
from merap.learning.models import train_models
from merap.mdp.gymnasium_import import import_gymnasium
from merap.mdp.planning import optimum
from merap.online.managed.gymnasium import GymnasiumSystem
from merap.online.running import adaptation, evaluator
from merap.online.strategies.gradient import GradientStrategy

HORIZON = 30
EPISODES = 35


def lake(seed: int) -> gymnasium.Env[Any, Any]:
    """An 8 x 8 map; an episode ends in a hole, in the goal, or after the horizon."""
    return gymnasium.make(
        "FrozenLake-v1",
        desc=generate_random_map(8, seed=seed),
        is_slippery=False,
        max_episode_steps=HORIZON,
    )


def main(
    updates: Annotated[int, typer.Option(min=1)] = 150,
    steps: Annotated[int, typer.Option(min=1, help="Gradient steps on the map that is met.")] = 8,
    met: Annotated[int, typer.Option(help="Seed of that map; those below 64 were learned from.")] = 1000,
) -> None:
    """Print how often the goal is reached after each step."""
    models = [import_gymnasium(lake(seed)) for seed in range(64)]
    meta = train_models(models, HORIZON, 0.95, TrainingConfig(updates=updates))

    model = import_gymnasium(lake(met))  # to keep the score; the strategy sees reset and step alone
    strategy = GradientStrategy(meta, model.valuations, EPISODES, np.random.default_rng(0))
    system = GymnasiumSystem(lake(met), seed=0)
    print(f"the best policy reaches the goal with probability {optimum(model, HORIZON):.2f}")
    for row in adaptation(system, strategy, evaluator(model, HORIZON), steps * EPISODES):
        print(f"after {row.episodes:3} episodes: {row.expected_return:.2f}")


if __name__ == "__main__":
    typer.run(main)
