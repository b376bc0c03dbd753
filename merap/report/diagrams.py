"""Processes as small state diagrams: what variables become, with which action, how likely."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

from merap.concerns.combination import Combination, DeclaredCombination
from merap.concerns.processes import DeclaredProcess
from merap.families.index import telling_variables
from merap.mdp.model import TabularMDP
from merap.program.form import Process, Program, StateVariable
from merap.report.diagram_nodes import Nodes, joint_nodes, value_nodes
from merap.report.diagram_steps import NodeStep, enabled_in, lines_of, node_steps

# Steps that lead to a node from so many others, and from all, are told at the node.
_MANY = 3


@dataclass(frozen=True)
class Node:
    """A value, or a range of values.

    Attributes:
        text: the values of the diagram's variables.
        notes: lines about steps that lead here from every other node, or change a value within the range.
        initial: whether an episode may begin here.
    """

    text: str
    notes: tuple[str, ...]
    initial: bool


@dataclass(frozen=True)
class Arrow:
    """Steps from one node to another; one line for each probability: actions, and how likely."""

    source: int
    target: int
    lines: tuple[str, ...]


@dataclass(frozen=True)
class Diagram:
    """Variables that change together.

    Attributes:
        title: names of the variables, of their process, and of the concern that owns it.
        nodes: in the order of their values.
        arrows: for steps that change a value; what has none stays.
    """

    title: str
    nodes: tuple[Node, ...]
    arrows: tuple[Arrow, ...]


def told_variables(program: Program) -> tuple[StateVariable, ...]:
    """Return the variables that say more than the location and whether the task is complete."""
    return tuple(
        one for one in telling_variables(program) if one.size > 1 and one.name not in program.location
    )


def process_diagrams(combination: Combination, mdp: TabularMDP) -> tuple[Diagram, ...]:
    """Return a diagram for each process with variables beside the location.

    Nodes are joint values that can be reached. Where there are too many, each variable has a diagram of
    its own, and of a long range the values between the ends are one node.

    Args:
        combination: with these processes.
        mdp: its model, with the variables of its program.
    """
    owners = _owners(combination)
    told = told_variables(combination.program)
    return tuple(
        diagram
        for owner, own in groupby(told, lambda one: owners[one.name])
        for diagram in _of_process(*owner, list(own), mdp)
    )


def _owners(combination: Combination) -> dict[str, tuple[str, str]]:
    """Return the process and the concern of each variable, as declared: the program may link processes."""
    processes: list[Process | DeclaredProcess] = [*combination.program.processes]
    if isinstance(combination, DeclaredCombination):
        processes += combination.processes
    return {
        variable.name: (process.name, process.concern)
        for process in processes
        for variable in process.variables
    }


def _of_process(process: str, concern: str, own: list[StateVariable], mdp: TabularMDP) -> Iterator[Diagram]:
    joint = joint_nodes(mdp, own)
    parts = [(own, joint)] if joint is not None else [([one], value_nodes(mdp, one)) for one in own]
    for part, nodes in parts:
        if len(nodes.texts) > 1:
            names = ", ".join(variable.name for variable in part)
            owner = concern if process in {names, concern} else f"{process}, {concern}"
            yield _diagram(f"{names} ({owner})", mdp, nodes)


def _diagram(title: str, mdp: TabularMDP, nodes: Nodes) -> Diagram:
    steps, known = node_steps(mdp, nodes), enabled_in(mdp, nodes)
    entering = _entering(steps, len(nodes.texts))
    initial = set(nodes.of_state[mdp.initial > 0].tolist())
    arrows = [
        Arrow(source, target, lines_of(list(own), known[source]))
        for (source, target), own in groupby(
            (step for step in steps if step.source != step.target and step not in entering),
            lambda step: (step.source, step.target),
        )
    ]
    return Diagram(
        title,
        tuple(
            Node(text, tuple(_notes(place, steps, entering, known)), place in initial)
            for place, text in enumerate(nodes.texts)
        ),
        tuple(arrows),
    )


def _entering(steps: Sequence[NodeStep], num_nodes: int) -> set[NodeStep]:
    """Return the steps that lead to one node from every other one, by the same action, equally likely."""
    alike: dict[tuple[int, str, str], list[NodeStep]] = {}
    for step in steps:
        if step.source != step.target:
            alike.setdefault((step.target, step.action, step.chance), []).append(step)
    return {step for same in alike.values() if len(same) == num_nodes - 1 >= _MANY for step in same}


def _notes(
    place: int, steps: Sequence[NodeStep], entering: set[NodeStep], known: Sequence[frozenset[str]]
) -> Iterator[str]:
    """Yield the lines of a node; `known` are the actions that are enabled in each node."""
    arriving = {
        (step.action, step.chance): step for step in steps if step.target == place and step in entering
    }
    elsewhere = frozenset().union(*known[:place], *known[place + 1 :])
    for line in lines_of(list(arriving.values()), elsewhere):
        yield f"{line} (from any)"
    within = [step for step in steps if step.source == step.target == place]
    for line in lines_of(within, known[place]):
        yield f"{line} (within)"
