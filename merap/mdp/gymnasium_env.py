"""Wrap a model as a Gymnasium environment, and register it.

Importing this module registers `merap/Tabular-v0`, so that also
`gymnasium.make("merap.mdp.gymnasium_env:merap/Tabular-v0", mdp=mdp, horizon=18)` works.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from merap.errors import InputError
from merap.mdp.gymnasium_spaces import (
    ObservationKind,
    check_horizon,
    gymnasium,
    observation_space,
    observation_table,
)
from merap.mdp.gymnasium_vector import MDPVectorEnv
from merap.mdp.model import Bools, TabularMDP
from merap.mdp.simulation import simulator

TABULAR_ID = "merap/Tabular-v0"


class MDPEnv(gymnasium.Env[Any, Any]):
    """A model as a Gymnasium environment, one episode after the other.

    An action is a number into `action_names` (without `end`). `info["action_mask"]`, int8
    [A], marks the enabled ones; another one raises InputError, so choose by
    `env.action_space.sample(info["action_mask"])`. The same holds for Gymnasium's checker,
    which draws without a mask: give it a model that enables every action.

    An episode is terminated when it enters a state labelled `done`, truncated after
    `horizon` steps unless it is terminated. The reward is r(s, a, s'), or r(s, a) where the
    model knows no more. `seed` of `reset` determines everything that follows.

    Args:
        mdp: the model.
        horizon: steps until truncation, at least 1; None: never.
        observation: see `observation_table`.
        render_mode: None or `ansi`, one line of text.

    Raises:
        InputError: an argument is not of that form.
        ModelError: see `simulator`.
    """

    # A library may add entries to its own copy; the type is that of `gymnasium.Env`.
    metadata: dict[str, Any] = {"render_modes": ["ansi"], "render_fps": 4}  # noqa: RUF012

    def __init__(
        self,
        mdp: TabularMDP,
        horizon: int | None = None,
        *,
        observation: ObservationKind = "state",
        render_mode: str | None = None,
    ) -> None:
        check_horizon(horizon)
        if render_mode not in {None, "ansi"}:
            raise InputError(f"there is no render mode {render_mode!r}, only ansi")
        self.mdp = mdp
        self.horizon = horizon
        self.render_mode = render_mode
        self._simulator = simulator([mdp])
        self._table = observation_table(mdp, observation)
        self.action_names = self._simulator.action_names
        self.observation_space = observation_space(self._table)
        self.action_space = gymnasium.spaces.Discrete(len(self.action_names))
        self._action_mask = (self._simulator.choice >= 0).astype(np.int8)  # [S, A]
        self._state = -1
        self._steps = 0
        self._over = True
        self._last_step = ""

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode; there are no options."""
        super().reset(seed=seed)
        self._state = int(self._simulator.first_states(0, self.np_random.random()))
        self._steps = 0
        self._over = False
        self._last_step = ""
        return self._observation(), self._info()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Take an action.

        Raises:
            InputError: the action is not enabled here, or no episode is under way.
        """
        choice = self._choice(action)
        branch = self._simulator.successors.draw(choice, self.np_random.random())
        reward = float(self._simulator.reward[branch])
        self._state = int(self._simulator.target[branch])
        self._steps += 1
        terminated = bool(self._simulator.completed[self._state])
        truncated = self._steps == self.horizon and not terminated
        self._over = terminated or truncated
        self._last_step = f", after {self.action_names[action]}, reward {reward:g}"
        return self._observation(), reward, terminated, truncated, self._info()

    def action_masks(self) -> Bools:
        """Return bool [A], the actions enabled now (sb3-contrib's masked learners call this name)."""
        mask: Bools = self._simulator.choice[self._state] >= 0
        return mask

    def render(self) -> str:
        """Describe the state in one line: `step 3: (row=1, col=2), after right, reward -0.5`.

        Raises:
            InputError: the render mode isn't `ansi`.
        """
        if self.render_mode is None:
            raise InputError("to render, make the environment with render_mode='ansi'")
        labels = [f" {name}" for name, mask in self.mdp.labels.items() if mask[self._state]]
        state = self.mdp.describe_state(self._state) + "".join(labels)
        return f"step {self._steps}: {state}{self._last_step}"

    def _choice(self, action: Any) -> int:
        if self._over:
            raise InputError("no episode is under way: call reset() first")
        # The space's own check takes longer than the rest of a step, so plain integers do without.
        plain = isinstance(action, (int, np.integer)) and 0 <= action < len(self.action_names)
        if not plain and not self.action_space.contains(action):
            raise InputError(f"there is no action {action!r}, only 0 to {len(self.action_names) - 1}")
        choice = int(self._simulator.choice[self._state, action])
        if choice < 0:
            allowed = [self.action_names[number] for number in np.flatnonzero(self.action_masks())]
            raise InputError(
                f"action {self.action_names[action]} is not enabled in "
                f"{self.mdp.describe_state(self._state)}, only {', '.join(allowed)}; see info['action_mask']"
            )
        return choice

    def _observation(self) -> Any:
        # A copy, so that neither the caller's observation nor the table can change.
        return self._table[self._state].copy()

    def _info(self) -> dict[str, npt.NDArray[np.int8]]:
        return {"action_mask": self._action_mask[self._state].copy()}


def register_mdp(name: str, mdp: TabularMDP, horizon: int | None = None) -> str:
    """Give a model an id of its own, for `gymnasium.make` and `gymnasium.make_vec`.

    Args:
        name: as `PaperGrid`.
        mdp: the model.
        horizon: steps until truncation; None: never. `make` may override it.

    Returns:
        The id, as `merap/PaperGrid-v0`.

    Raises:
        InputError: the id is taken, or the horizon isn't positive.
    """
    env_id = f"merap/{name}-v0"
    if env_id in gymnasium.registry:
        raise InputError(f"there is an environment {env_id} already")
    check_horizon(horizon)

    # Functions, since Gymnasium copies a registered argument with every `make`.
    def make_env(**arguments: Any) -> MDPEnv:
        return MDPEnv(mdp, **arguments)

    def make_vector_env(**arguments: Any) -> MDPVectorEnv:
        return MDPVectorEnv(mdp, **arguments)

    gymnasium.register(
        env_id, entry_point=make_env, vector_entry_point=make_vector_env, kwargs={"horizon": horizon}
    )
    return env_id


gymnasium.register(
    TABULAR_ID,
    entry_point="merap.mdp.gymnasium_env:MDPEnv",
    vector_entry_point="merap.mdp.gymnasium_vector:MDPVectorEnv",
)
