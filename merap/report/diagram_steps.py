"""The steps between the nodes of a state diagram: with which action, how likely.

Axes: C choices, B branches, D nodes, A actions.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from merap.mdp.assembly import sum_by
from merap.mdp.model import TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL
from merap.report.diagram_nodes import Nodes

_MOST_LISTED, _MOST_LEFT_OUT = 4, 2


@dataclass(frozen=True)
class NodeStep:
    """An action that may lead from one node to another.

    Attributes:
        source: a node.
        target: a node; the same as the source if a value changes within its range.
        action: name of the action.
        chance: the probability, or its range over the states of the source in which the action is
            enabled; empty for 1.
    """

    source: int
    target: int
    action: str
    chance: str


def node_steps(mdp: TabularMDP, nodes: Nodes) -> list[NodeStep]:
    """Return the steps that change a value, in order of source, target and action."""
    num_nodes, num_actions = len(nodes.texts), mdp.num_actions
    state = np.repeat(np.arange(mdp.num_states), np.diff(mdp.state_to_choice))
    going = ~mdp.labels[COMPLETE_LABEL][state]
    pair = nodes.of_state[state] * num_actions + mdp.choice_action
    total = np.bincount(pair[going], minlength=num_nodes * num_actions)
    choice = np.repeat(np.arange(mdp.num_choices), np.diff(mdp.choice_to_branch))
    changes = (nodes.values[state[choice]] != nodes.values[mdp.branch_target]).any(axis=1) & going[choice]
    target = nodes.of_state[mdp.branch_target[changes]]
    jumps, of_jump = np.unique(choice[changes] * num_nodes + target, return_inverse=True)
    prob = sum_by(of_jump, mdp.branch_prob[changes], len(jumps))
    # for each step between nodes: the least and the greatest probability over choices
    steps, of_step = np.unique(pair[jumps // num_nodes] * num_nodes + jumps % num_nodes, return_inverse=True)
    low, high = np.ones(len(steps)), np.zeros(len(steps))
    np.minimum.at(low, of_step, prob)
    np.maximum.at(high, of_step, prob)
    low[np.bincount(of_step, minlength=len(steps)) < total[steps // num_nodes]] = 0
    return sorted(
        (
            NodeStep(
                step // num_nodes // num_actions,
                step % num_nodes,
                mdp.action_names[step // num_nodes % num_actions],
                _chance(*bounds),
            )
            for step, *bounds in zip(steps.tolist(), low.tolist(), high.tolist(), strict=True)
        ),
        key=lambda step: (step.source, step.target),
    )


def _chance(low: float, high: float) -> str:
    texts = f"{low:.3g}", f"{high:.3g}"
    if texts[0] != texts[1]:
        return "–".join(texts)
    return "" if texts[1] == "1" else texts[1]


def enabled_in(mdp: TabularMDP, nodes: Nodes) -> list[frozenset[str]]:
    """Return D sets: the actions that are enabled in some state of a node that is not complete."""
    open_ = ~mdp.labels[COMPLETE_LABEL]
    return [
        frozenset(
            name
            for name, known in zip(
                mdp.action_names, mdp.enabled[open_ & (nodes.of_state == node)].any(axis=0), strict=True
            )
            if known
        )
        for node in range(len(nodes.texts))
    ]


def lines_of(steps: Sequence[NodeStep], known: Collection[str]) -> tuple[str, ...]:
    """Return one line for each probability: the actions, and how likely.

    Args:
        steps: with one source and one target.
        known: the actions that are enabled at the source.
    """

    def lines() -> Iterator[str]:
        for chance, same in groupby(sorted(steps, key=lambda step: step.chance), lambda step: step.chance):
            names = _names([step.action for step in same], known)
            yield f"{names}: {chance}" if chance else names

    return tuple(lines())


def _names(actions: list[str], known: Collection[str]) -> str:
    others = sorted(set(known) - set(actions))
    if not others and len(actions) > 1:
        return "any action"
    if len(actions) <= _MOST_LISTED:
        return ", ".join(actions)
    if len(others) <= _MOST_LEFT_OUT:
        return f"any but {', '.join(others)}"
    return f"{', '.join(actions[:2])} and {len(actions) - 2} more"
