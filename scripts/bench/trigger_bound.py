"""What no detector can do better: how much a change tells, and how often it can be told in time.

Whoever knows beforehand what will change, and only has to find out when, learns nothing from the steps but
the likelihood ratio of what is there to what is known. Two bounds follow:

1. *Mean delay.* With n steps on average per false alarm it is at least log(n) / D episodes, asymptotically in
   n, where D is the mean of the ratio's logarithm over an episode after the change, a relative entropy
   (Lorden 1971; Lai 1998, "Information bounds and quick detection of parameter changes").
2. *In time.* An alarm within so many episodes is a test, on what they show, of a change against none. The
   likelihood-ratio test has the most power for its size (Neyman and Pearson 1933), and that power is concave
   in the size. So if a change may come with any episode equally likely, the part of changes that a detector
   sees in time is at most the power for the mean size: its false alarms in as many episodes without a
   change. This one holds as it stands, not only asymptotically.

Axes: M steps, B branches of what is there, S states.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from merap.mdp.assembly import sum_by
from merap.mdp.evaluation import choice_weights
from merap.mdp.matching import match_keys
from merap.mdp.model import Floats, Ints, TabularMDP
from merap.strategies.evaluation import executed
from merap.trigger.readings import ObservedSteps
from scripts.bench.trigger_streams import Known, gaussian, stream

# Drawn windows: a power near 0.95 has a standard error of 0.5 %.
DRAWN = 2000


@dataclass(frozen=True, eq=False)
class Ratio:
    """The likelihood ratio of what is there to what is known, by branches of the former.

    Attributes:
        real: what is there.
        log_odds: float64 [B], of the successor; infinite where it is held impossible.
        reward: float64 [B], mean of what is paid.
        expected: float64 [B], what the known model expects to be paid.
        noise: standard deviation of the noise on rewards, Gaussian.
    """

    real: TabularMDP
    log_odds: Floats
    reward: Floats
    expected: Floats
    noise: float

    def means(self) -> Floats:
        """Return float64 [B], mean of the logarithm over the noise."""
        return self.log_odds + (self.reward - self.expected) ** 2 / (2 * self.noise**2)

    def logs(self, steps: ObservedSteps) -> Floats:
        """Return float64 [M], the logarithm for steps of the real model."""
        key = _key(self.real, steps.state, steps.action, steps.target)
        branch = match_keys(key, _keys(self.real))
        misfit = (steps.reward - self.expected[branch]) ** 2 - (steps.reward - self.reward[branch]) ** 2
        return self.log_odds[branch] + misfit / (2 * self.noise**2)


def ratio(known: TabularMDP, real: TabularMDP, noise: float) -> Ratio:
    """Match the branches of what is there with those of what is known.

    Args:
        known: canonical.
        real: canonical, on the same index.
        noise: standard deviation of the noise on rewards.
    """
    branch = match_keys(_keys(real), _keys(known))
    held = np.where(branch >= 0, known.branch_prob[branch], 0.0)
    with np.errstate(divide="ignore"):
        log_odds = np.log(real.branch_prob) - np.log(held)
    reward = real.mean_branch_reward
    expected = np.where(branch >= 0, known.mean_branch_reward[branch], reward)
    return Ratio(real, log_odds, reward, expected, noise)


def visits(before: Known, real: TabularMDP) -> Floats:
    """Return float64 [B], how often an episode of the known model's policy takes each branch on average.

    Completed states count as 0, so the sum is the mean length of an episode.
    """
    policy = executed(real, before.policy)
    acting = real.choice_action != real.num_actions - 1
    here, total = real.initial, np.zeros(real.num_branches)
    for t in range(before.horizon):
        taken = choice_weights(real, policy[t]) * here[real.choice_state]
        flow = taken[real.branch_choice] * real.branch_prob
        total += flow * acting[real.branch_choice]
        here = sum_by(real.branch_target, flow, real.num_states)
    return total


def nats_per_episode(before: Known, change: Ratio) -> float:
    """Return D of the first bound, exact; infinite if something can happen that is held impossible."""
    weight = visits(before, change.real)
    seen = weight > 0
    return float(weight[seen] @ change.means()[seen])


def most_in_time(
    before: Known, change: Ratio, episodes: int, rates: tuple[float, ...], generator: np.random.Generator
) -> tuple[float, ...]:
    """Return the second bound: the part of the changes that any detector can see within some episodes.

    Args:
        before: what is known.
        change: to what is there.
        episodes: after the change.
        rates: false alarms per step; a bound for each.
        generator: of the draws.
    """
    steps = stream(before, change.real, episodes * DRAWN, gaussian(change.noise), generator)
    episode: Ints = np.cumsum(steps.last) - steps.last
    logs = sum_by(episode // episodes, change.logs(steps), DRAWN)
    length = episodes * visits(before, before.model).sum()
    return tuple(power(logs, rate * length) for rate in rates)


def power(logs: Floats, size: float) -> float:
    """Return the power of the likelihood-ratio test of that size.

    The size of {ratio > c} is the mean of 1 / ratio over it after the change; draws from before the change
    would not tell sizes that small.

    Args:
        logs: float64, logarithms of the ratio, drawn after the change.
        size: probability of an alarm without a change.
    """
    sizes = np.cumsum(np.exp(-np.sort(logs)[::-1])) / len(logs)
    return float(np.searchsorted(sizes, size, side="right") / len(logs))


def _key(model: TabularMDP, state: Ints, action: Ints, target: Ints) -> Ints:
    return (state * model.num_actions + action) * model.num_states + target


def _keys(model: TabularMDP) -> Ints:
    """Return int64 [B], one for each state, action and successor."""
    choice = model.branch_choice
    return _key(model, model.choice_state[choice], model.choice_action[choice], model.branch_target)
