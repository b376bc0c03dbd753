"""From steps that were seen to readings: what the current model and the policy's values say of them.

Axes: M steps, S states, A actions, C choices, B branches as in `TabularMDP`, T steps of an episode, W
changes watched for everywhere, H at a place alone.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from merap.mdp.assembly import sum_by
from merap.mdp.csr import ragged_indices, row_best
from merap.mdp.evaluation import policy_values
from merap.mdp.model import Bools, Floats, Ints, TabularMDP
from merap.mdp.planning import initial_value
from merap.trigger.settings import ChangeSettings
from merap.trigger.trigger import Reading

# Probabilities that differ by less count as equally large.
TIES = 1e-9
# Changes of one state and action: all but the likeliest successor have 30 times the odds, or every other
# step can do anything. Odds, and part of the steps that can do anything.
LOCAL_ODDS = (30.0, 1.0)
LOCAL_SHARE = (0.02, 0.5)
# Where a step ends up that does what the model holds impossible: next to where it began, or anywhere.
NEAR = 0.9


@dataclass(frozen=True, eq=False)
class ObservedSteps:
    """Steps that were seen, on the canonical index.

    Attributes:
        time: int64 [M], since the episode began.
        state: int64 [M].
        action: int64 [M].
        target: int64 [M], the successor.
        reward: float64 [M], as received.
        last: bool [M], the episode is over.
    """

    time: Ints
    state: Ints
    action: Ints
    target: Ints
    reward: Floats
    last: Bools


@dataclass(frozen=True, eq=False)
class Readings:
    """M readings as arrays, no step missed; the attributes are those of `Reading`.

    Attributes:
        reward: float64 [M].
        expected_reward: float64 [M].
        log_likelihood: float64 [M].
        log_alternatives: float64 [M, W].
        place: int64 [M].
        log_local: float64 [M, H].
        gain: float64 [M].
        gain_variance: float64 [M].
        policy_value: the same for all.
        last: bool [M], the episode is over with it.
    """

    reward: Floats
    expected_reward: Floats
    log_likelihood: Floats
    log_alternatives: Floats
    place: Ints
    log_local: Floats
    gain: Floats
    gain_variance: Floats
    policy_value: float
    last: Bools

    def __len__(self) -> int:
        return len(self.reward)

    def part(self, chosen: slice | Bools) -> Readings:
        """Some of the readings, in their order."""
        arrays = {
            entry.name: getattr(self, entry.name)[chosen]
            for entry in fields(self)
            if entry.name != "policy_value"
        }
        return Readings(**arrays, policy_value=self.policy_value)

    def __getitem__(self, index: int) -> Reading:
        """The reading of one step."""
        return Reading(
            reward=float(self.reward[index]),
            expected_reward=float(self.expected_reward[index]),
            log_likelihood=float(self.log_likelihood[index]),
            log_alternatives=tuple(self.log_alternatives[index].tolist()),
            place=int(self.place[index]),
            log_local=tuple(self.log_local[index].tolist()),
            gain=float(self.gain[index]),
            gain_variance=float(self.gain_variance[index]),
            policy_value=self.policy_value,
        )


class Forecast:
    """What a model expects while a policy is carried out.

    Values are undiscounted, over the horizon. Rewards are expected for the successor that is seen where the
    model tells rewards of branches (`branch_reward`). Where rewards depend on the successor, give such a
    model: else their spread is taken for noise that was not stated.

    Args:
        model: the current one, canonical.
        policy: float64 [S, A] or [T, S, A], see `merap.mdp.evaluation.policy_values`.
        horizon: T.
        settings: of the detector: floor and watched changes.

    Raises:
        ModelError: the policy isn't of that form.
    """

    def __init__(self, model: TabularMDP, policy: Floats, horizon: int, settings: ChangeSettings) -> None:
        self._model = model
        self._values = policy_values(model, policy, horizon)
        self._settings = settings
        self.policy_value = initial_value(model, self._values[0])
        self._branch_key = model.branch_choice * model.num_states + model.branch_target
        self._by_key = np.argsort(self._branch_key)
        self._branch_key = self._branch_key[self._by_key]
        best = row_best(model.branch_prob, model.choice_to_branch, maximise=True)
        self._unlikely = model.branch_prob < best[model.branch_choice] * (1 - TIES)
        self._surprise = np.bincount(
            model.branch_choice, model.branch_prob * self._unlikely, minlength=model.num_choices
        )
        self._near, self._num_near = _neighbourhoods(model)

    def read(self, steps: ObservedSteps) -> Readings:
        """Hold steps against the model."""
        choice = self._model.choice_table[steps.state, steps.action]
        branch = self._branches(choice, steps.target)
        before, after = self._values[steps.time, steps.state], self._values[steps.time + 1, steps.target]
        mean, variance = self._moments(choice, steps.time + 1)
        reward = np.where(choice >= 0, self._model.choice_reward[choice], 0.0)
        reward = np.where(branch >= 0, self._model.mean_branch_reward[branch], reward)
        log_likelihood, log_changed = self._likelihoods(steps, choice, branch)
        everywhere = len(self._settings.odds)
        return Readings(
            reward=steps.reward,
            expected_reward=reward,
            log_likelihood=log_likelihood,
            log_alternatives=log_changed[:, :everywhere],
            place=choice,
            log_local=log_changed[:, everywhere:],
            gain=reward + after - np.where(choice >= 0, mean, before),
            gain_variance=variance,
            policy_value=self.policy_value,
            last=steps.last,
        )

    def read_step(self, time: int, state: int, action: int, target: int, reward: float) -> Reading:
        """Hold one step against the model; the arguments are those of `ObservedSteps`."""
        steps = ObservedSteps(
            time=np.array([time]),
            state=np.array([state]),
            action=np.array([action]),
            target=np.array([target]),
            reward=np.array([reward]),
            last=np.array([False]),
        )
        return self.read(steps)[0]

    def _branches(self, choice: Ints, target: Ints) -> Ints:
        """int64 [M], the branch from each choice to its target; -1: the model has none."""
        key = choice * self._model.num_states + target
        place = np.minimum(np.searchsorted(self._branch_key, key), len(self._branch_key) - 1)
        found: Ints = np.where((choice >= 0) & (self._branch_key[place] == key), self._by_key[place], -1)
        return found

    def _moments(self, choice: Ints, time: Ints) -> tuple[Floats, Floats]:
        """Mean and variance of reward and value that follow a choice, float64 [M] each; 0 for choice -1."""
        known = np.flatnonzero(choice >= 0)
        pointers = self._model.choice_to_branch
        branch = ragged_indices(pointers, choice[known])
        step = np.repeat(known, np.diff(pointers)[choice[known]])
        worth = (
            self._model.mean_branch_reward[branch]
            + self._values[time[step], self._model.branch_target[branch]]
        )
        prob = self._model.branch_prob[branch]
        mean = sum_by(step, prob * worth, len(choice))
        return mean, sum_by(step, prob * (worth - mean[step]) ** 2, len(choice))

    def _likelihoods(self, steps: ObservedSteps, choice: Ints, branch: Ints) -> tuple[Floats, Floats]:
        """Of the successors, under the model [M] and the watched changes [M, W + H]."""
        settings = self._settings
        anything = self._anything(steps)
        prob = np.where(branch >= 0, self._model.branch_prob[branch], 0.0)
        # A state that the model does not reach says nothing: anything can happen there.
        floor = np.where(choice >= 0, settings.floor, 1.0)
        shares = np.array([settings.share] * len(settings.odds) + [*LOCAL_SHARE])
        share = np.where((choice >= 0)[:, np.newaxis], shares, 1.0)
        odds = np.array([*settings.odds, *LOCAL_ODDS])
        surprise = np.where(choice >= 0, self._surprise[choice], 0.0)[:, np.newaxis]
        unlikely = ((branch >= 0) & self._unlikely[branch])[:, np.newaxis]
        shifted = prob[:, np.newaxis] * np.where(unlikely, odds, 1.0) / (1 + (odds - 1) * surprise)
        under_change = (1 - share) * shifted + share * anything[:, np.newaxis]
        return np.log((1 - floor) * prob + floor * anything), np.log(under_change)

    def _anything(self, steps: ObservedSteps) -> Floats:
        """float64 [M], probability of the successors if anything can happen."""
        num_states = self._model.num_states
        key = steps.state * num_states + steps.target
        place = np.minimum(np.searchsorted(self._near, key), len(self._near) - 1)
        near = self._near[place] == key
        spread: Floats = NEAR * near / self._num_near[steps.state] + (1 - NEAR) / num_states
        return spread


def joined(first: Readings, second: Readings) -> Readings:
    """One stream and then another, both held against one model."""
    arrays = {
        entry.name: np.concatenate([getattr(first, entry.name), getattr(second, entry.name)])
        for entry in fields(first)
        if entry.name != "policy_value"
    }
    return Readings(**arrays, policy_value=first.policy_value)


def _neighbourhoods(model: TabularMDP) -> tuple[Ints, Ints]:
    """Where any action can lead from a state, or staying: keys `state * S + target`, and how many [S]."""
    stay = np.arange(model.num_states)
    source = np.concatenate([model.choice_state[model.branch_choice], stay])
    target = np.concatenate([model.branch_target, stay])
    keys = np.unique(source * model.num_states + target)
    return keys, np.bincount(keys // model.num_states, minlength=model.num_states)
