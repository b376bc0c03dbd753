"""Wrap one or several models as a Gymnasium vector environment, for many episodes at once.

Axes: N models, B environments, S states, A actions.
"""

from __future__ import annotations

from collections.abc import Sequence
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
from merap.mdp.model import Bools, Floats, Ints, TabularMDP
from merap.mdp.simulation import simulator

AutoresetMode = gymnasium.vector.AutoresetMode
Step = tuple[npt.NDArray[Any], Floats, Bools, Bools, dict[str, Any]]


class MDPVectorEnv(gymnasium.vector.VectorEnv[npt.NDArray[Any], Any, npt.NDArray[Any]]):
    """B environments stepped by a few gathers, whatever B is.

    Distributed as `SyncVectorEnv` of as many `MDPEnv`, but all draw from one generator:
    `seed` determines all of them together (with B = 1 both give the same episodes). Returned
    arrays are the caller's. `infos["action_mask"]` is int8 [B, A].

    Autoreset as Gymnasium has it: `NEXT_STEP` (the step after an end ignores the action
    and begins an episode, reward 0), `SAME_STEP` (the ending step returns the next
    episode's first observation, and the last one in `infos["final_obs"]`) and `DISABLED`
    (the caller resets those that ended by `options={"reset_mask": bool [B]}`).

    Args:
        mdp: one model, or N models of one case; with several, environments
            n * B / N to (n + 1) * B / N - 1 act on model n.
        num_envs: B, a multiple of N; by default N.
        horizon: as in `MDPEnv`.
        observation: as in `MDPEnv`.
        autoreset_mode: see above; or its value, as `SameStep`.

    Raises:
        InputError: an argument is not of that form.
        ModelError: see `simulator`.
    """

    def __init__(
        self,
        mdp: TabularMDP | Sequence[TabularMDP],
        num_envs: int | None = None,
        horizon: int | None = None,
        *,
        observation: ObservationKind = "state",
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ) -> None:
        check_horizon(horizon)
        self.models = (mdp,) if isinstance(mdp, TabularMDP) else tuple(mdp)
        self._simulator = simulator(self.models)
        self.num_envs = len(self.models) if num_envs is None else num_envs
        if self.num_envs < 1 or self.num_envs % len(self.models):
            raise InputError(
                f"{self.num_envs} environments can't be shared out among {len(self.models)} models"
            )
        self.horizon = horizon
        self.autoreset_mode = _autoreset_mode(autoreset_mode)
        self.metadata = {"render_modes": [], "autoreset_mode": self.autoreset_mode}
        self.action_names = self._simulator.action_names
        table = observation_table(self.models[0], observation)
        self._table = np.concatenate([table] * len(self.models))  # [N * S, ...]
        self.single_observation_space = observation_space(table)
        self.single_action_space = gymnasium.spaces.Discrete(len(self.action_names))
        batch_space = gymnasium.vector.utils.batch_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._model: Ints = np.arange(self.num_envs) * len(self.models) // self.num_envs  # [B]
        self._action_mask = (self._simulator.choice >= 0).astype(np.int8)  # [N * S, A]
        self._limit = np.inf if horizon is None else horizon
        self._state: Ints | None = None  # [B], None before the first reset
        self._steps: Ints = np.zeros(self.num_envs, dtype=np.int64)
        self._over: Bools = np.zeros(self.num_envs, dtype=np.bool_)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[npt.NDArray[Any], dict[str, Any]]:
        """Begin an episode in every environment, or in those of `options["reset_mask"]`, bool [B].

        Raises:
            InputError: the mask isn't of that form, or is given before the first reset.
        """
        mask = self._reset_mask(options)
        super().reset(seed=seed)
        state = self._first_states()
        self._state = state if self._state is None else np.where(mask, state, self._state)
        self._steps[mask] = 0
        self._over = self._over & ~mask
        return self._observations(self._state), self._infos(self._state, mask)

    def step(self, actions: npt.ArrayLike) -> Step:
        """Take an action in every environment.

        Args:
            actions: integers [B]; those of environments about to be reset are ignored.

        Raises:
            InputError: an action is not enabled, or an environment has to be reset first.
        """
        restart = self._over
        choice = self._choices(np.asarray(actions))
        uniform = self.np_random.random(self.num_envs)
        branch = self._simulator.successors.draw(choice, uniform)
        state = self._simulator.target[branch]
        reward = self._simulator.reward[branch]
        steps = self._steps + 1
        if restart.any():
            state = np.where(restart, self._simulator.first_states(self._model, uniform), state)
            reward[restart] = 0.0
            steps[restart] = 0
        terminated = self._simulator.completed[state]
        truncated = (steps >= self._limit) & ~terminated
        self._state, self._steps, self._over = state, steps, terminated | truncated
        final = self._restart_now() if self.autoreset_mode is AutoresetMode.SAME_STEP else {}
        everywhere = np.ones(self.num_envs, dtype=np.bool_)
        infos = {**final, **self._infos(self._state, everywhere)}
        return self._observations(self._state), reward, terminated, truncated, infos

    def action_masks(self) -> Bools:
        """Return bool [B, A], the actions that are enabled now."""
        return self._action_mask[self._started()].astype(np.bool_)

    def _started(self) -> Ints:
        if self._state is None:
            raise InputError("no episode is under way: call reset() first")
        return self._state

    def _first_states(self) -> Ints:
        return self._simulator.first_states(self._model, self.np_random.random(self.num_envs))

    def _reset_mask(self, options: dict[str, Any] | None) -> Bools:
        if options is None or "reset_mask" not in options:
            return np.ones(self.num_envs, dtype=np.bool_)
        mask = np.asarray(options["reset_mask"])
        if mask.dtype != np.bool_ or mask.shape != (self.num_envs,):
            raise InputError(
                f"reset_mask must be bool [{self.num_envs}], it is {mask.dtype} {list(mask.shape)}"
            )
        self._started()
        return mask

    def _choices(self, actions: npt.NDArray[Any]) -> Ints:
        """Return int64 [B], the choices taken; an arbitrary one where the action is ignored."""
        state = self._started()
        if self.autoreset_mode is AutoresetMode.DISABLED and self._over.any():
            ended = int(np.flatnonzero(self._over)[0])
            raise InputError(f"environment {ended} has ended: reset it by options={{'reset_mask': ...}}")
        taken = self._checked(actions)
        choice: Ints = self._simulator.choice[state, taken]
        if choice.min() >= 0:
            return choice
        disabled = np.flatnonzero((choice < 0) & ~self._over)
        if len(disabled):
            number = int(disabled[0])
            model, own = divmod(int(state[number]), self._simulator.num_states)
            raise InputError(
                f"environment {number}: action {self.action_names[taken[number]]} is not enabled in "
                f"{self.models[model].describe_state(own)}; see infos['action_mask']"
            )
        return np.maximum(choice, 0)

    def _checked(self, actions: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Check the actions and return them, [B], 0 where they are ignored."""
        if actions.shape != (self.num_envs,) or actions.dtype.kind not in "iu":
            raise InputError(
                f"actions must be integers [{self.num_envs}], not {actions.dtype} {list(actions.shape)}"
            )
        taken = np.where(self._over, 0, actions)
        if taken.min() < 0 or taken.max() >= len(self.action_names):
            number = int(np.flatnonzero((taken < 0) | (taken >= len(self.action_names)))[0])
            raise InputError(
                f"environment {number}: there is no action {taken[number]}, "
                f"only 0 to {len(self.action_names) - 1}"
            )
        return taken

    def _restart_now(self) -> dict[str, Any]:
        """Begin the next episode where one is over; return the infos of the last states."""
        over = self._over
        if not over.any():
            return {}
        state = self._started()
        final_obs = np.full(self.num_envs, None, dtype=object)
        last = self._observations(state[over])
        final_obs[over] = np.fromiter(last, dtype=object, count=len(last))
        final_info = self._infos(state, over)
        self._state = np.where(over, self._first_states(), state)
        self._steps = np.where(over, 0, self._steps)
        self._over = np.zeros(self.num_envs, dtype=np.bool_)
        return {
            "final_obs": final_obs,
            "_final_obs": over.copy(),
            "final_info": final_info,
            "_final_info": over.copy(),
        }

    def _observations(self, state: Ints) -> npt.NDArray[Any]:
        observed: npt.NDArray[Any] = self._table[state]
        return observed

    def _infos(self, state: Ints, mask: Bools) -> dict[str, Any]:
        """Return the action masks of some environments in Gymnasium's form: 0 for the others."""
        action_mask = self._action_mask[state]
        return {
            "action_mask": action_mask if mask.all() else action_mask * mask[:, np.newaxis],
            "_action_mask": mask.copy(),
        }


def _autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    try:
        return AutoresetMode(mode)
    except ValueError as error:
        allowed = ", ".join(known.value for known in AutoresetMode)
        raise InputError(f"there is no autoreset mode {mode!r}, only {allowed}") from error
