"""The softmax over enabled actions, and its derivatives; tables are [N, S, A]."""

from __future__ import annotations

import numpy as np

from merap.learning.core.jit import Array, Bools, compiled

# What a probability that has been rounded to 0 counts as.
LEAST = 1e-37


def masked_softmax(logits: Array, enabled: Bools) -> Array:
    """Probabilities of logits [N, S, A] or [S, A], over the enabled actions; 0 in a row without any."""
    return _masked_softmax(logits.reshape(-1, *enabled.shape[1:]), enabled)


def divergence(old: Array, new: Array, visits: Array) -> Array:
    """KL(old || new) in nats, weighted by visits [N, S]; float [N]."""
    surprise = old * (np.log(np.maximum(old, LEAST)) - np.log(np.maximum(new, LEAST)))
    total: Array = np.einsum("ns,nsa->n", visits, surprise)
    return total


@compiled
def _masked_softmax(logits: Array, enabled: Bools) -> Array:
    """Of logits [R, S, A], R 1 or N."""
    policy = np.zeros(enabled.shape, dtype=logits.dtype)
    num_tasks, num_states, num_actions = enabled.shape
    for n in range(num_tasks):
        r = n if len(logits) > 1 else 0
        for s in range(num_states):
            greatest = logits.dtype.type(-np.inf)
            for a in range(num_actions):
                if enabled[n, s, a]:
                    greatest = max(greatest, logits[r, s, a])
            total = logits.dtype.type(0)
            for a in range(num_actions):
                if enabled[n, s, a]:
                    policy[n, s, a] = np.exp(logits[r, s, a] - greatest)
                    total += policy[n, s, a]
            for a in range(num_actions):
                if enabled[n, s, a]:
                    policy[n, s, a] /= total
    return policy


@compiled
def through_log_softmax(policy: Array, weights: Array) -> Array:
    """A gradient in log pi as one in the logits; weights are 0 where an action is disabled."""
    result = np.empty_like(policy)
    num_tasks, num_states, num_actions = policy.shape
    for n in range(num_tasks):
        for s in range(num_states):
            total = policy.dtype.type(0)
            for a in range(num_actions):
                total += weights[n, s, a]
            for a in range(num_actions):
                result[n, s, a] = weights[n, s, a] - policy[n, s, a] * total
    return result


@compiled
def through_softmax(policy: Array, gradient: Array) -> Array:
    """A gradient in pi as one in the logits; also d pi of d logits, since that map is symmetric."""
    result = np.empty_like(policy)
    num_tasks, num_states, num_actions = policy.shape
    for n in range(num_tasks):
        for s in range(num_states):
            mean = policy.dtype.type(0)
            for a in range(num_actions):
                mean += policy[n, s, a] * gradient[n, s, a]
            for a in range(num_actions):
                result[n, s, a] = policy[n, s, a] * (gradient[n, s, a] - mean)
    return result


@compiled
def less_expected(policy: Array, weight: Array, scale: Array, gradient: Array) -> Array:
    """weight [N, S, A] less scale [N] times a gradient in pi, taken as one in the logits."""
    result = through_softmax(policy, gradient)
    num_tasks, num_states, num_actions = policy.shape
    for n in range(num_tasks):
        for s in range(num_states):
            for a in range(num_actions):
                result[n, s, a] = weight[n, s, a] - scale[n] * result[n, s, a]
    return result


@compiled
def sampling_noise(policy: Array, sampled: Array, scale: Array, gradient: Array) -> Array:
    """A sampled slope in log pi as one in the logits, without its expectation.

    Args:
        policy: float [N, S, A].
        sampled: float [N, S, A], in log pi.
        scale: float [N]: minus scale times the gradient is what it is expected to be, in pi.
        gradient: float [N, S, A], in pi.
    """
    return less_expected(policy, through_log_softmax(policy, sampled), -scale, gradient)


@compiled
def through_softmax_dot(
    policy: Array, policy_dot: Array, gradient: Array, gradient_dot: Array, scale: Array
) -> Array:
    """scale [N] times the derivative of `through_softmax` where policy and gradient both change."""
    result = np.empty_like(policy)
    num_tasks, num_states, num_actions = policy.shape
    for n in range(num_tasks):
        for s in range(num_states):
            mean = mean_dot = policy.dtype.type(0)
            for a in range(num_actions):
                mean += policy[n, s, a] * gradient[n, s, a]
                mean_dot += policy_dot[n, s, a] * gradient[n, s, a] + policy[n, s, a] * gradient_dot[n, s, a]
            for a in range(num_actions):
                of_policy = policy_dot[n, s, a] * (gradient[n, s, a] - mean)
                of_gradient = policy[n, s, a] * (gradient_dot[n, s, a] - mean_dot)
                result[n, s, a] = scale[n] * (of_policy + of_gradient)
    return result


@compiled
def entropy_slope(policy: Array, visits: Array) -> tuple[Array, Array]:
    """Entropy in nats weighted by visits [N, S], float64 [N]; its gradient in shared logits [1, S, A]."""
    num_tasks, num_states, num_actions = policy.shape
    slope = np.zeros((1, num_states, num_actions), dtype=policy.dtype)
    surprise = np.zeros(num_actions, dtype=policy.dtype)
    total = np.zeros(num_tasks)
    for n in range(num_tasks):
        for s in range(num_states):
            if visits[n, s] > 0:
                entropy = policy.dtype.type(0)
                for a in range(num_actions):
                    p = policy[n, s, a]
                    surprise[a] = -p * np.log(p) if p > 0 else 0 * p
                    entropy += surprise[a]
                for a in range(num_actions):
                    slope[0, s, a] += visits[n, s] * (surprise[a] - policy[n, s, a] * entropy)
                total[n] += visits[n, s] * entropy
    return total, slope
