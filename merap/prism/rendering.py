"""Combinations as PRISM text: readable, deterministic, valid for Storm and for PRISM-games."""

from __future__ import annotations

import re
import textwrap
from functools import lru_cache
from importlib.resources import files
from itertools import accumulate

import jinja2
import numpy as np

from merap.concerns.combination import Combination
from merap.concerns.lookup import as_combination
from merap.mdp.model import Bools, TabularMDP
from merap.mdp.reserved_names import MODE_VARIABLE
from merap.prism.capability_text import capability_text
from merap.prism.lines import Formula
from merap.prism.location_text import predicate
from merap.prism.objective_text import ObjectiveText, objective_text
from merap.prism.policy_text import policy_text
from merap.prism.space_text import space_text
from merap.prism.step_text import StepWriter
from merap.prism.terms import bare, conjunction

WIDTH = 120
_GLUE = "\0"
_UNBROKEN = re.compile(r" \? | :|\([^()?|]*\)")


def render(combination: Combination) -> str:
    """The PRISM model of a combination: modules `space`, `capability` and `objective`.

    The text depends on the combination alone: same input, same bytes.

    Raises:
        InputError: it is no combination.
    """
    as_combination(combination)
    return _render(combination, combination.objective.start > 0, with_objective=True)


def render_pair(combination: Combination, starts: Bools) -> str:
    """The PRISM model of environment and capability alone, for every objective to be attached to.

    Args:
        combination: whose environment and capability are rendered; its objective is not.
        starts: bool [P], all locations an episode may begin in under any objective.
    """
    return _render(combination, starts, with_objective=False)


def render_policy(combination: Combination, chain: TabularMDP, title: str) -> str:
    """A system under a policy as a Markov chain, with the labels and rewards of its combination.

    Args:
        combination: of the system.
        chain: what the policy makes of the combination's whole model, one choice for each
            state; all of them reachable, in the variables of `render`.
        title: one line that says which policy it is.
    """
    assert "\n" not in title, title
    starts = combination.objective.start > 0
    fixed_start = int(np.count_nonzero(starts)) == 1
    writer = StepWriter(combination)
    objective = objective_text(writer, fixed_start=fixed_start)
    of_moves = StepWriter(combination)  # another one, as the chain needs no attributes for moves
    return _lines(
        "policy.prism.j2",
        combination=combination,
        title=title,
        space=space_text(of_moves, starts),
        capability=capability_text(of_moves, fixed_start=fixed_start),
        start_key=[] if fixed_start else _start_key(combination),
        attributes=_named_in(objective, writer.formulas.take()),
        objective=objective,
        policy=policy_text(combination, chain),
        initial=None if fixed_start else _initial(writer, starts),
    )


def _named_in(objective: ObjectiveText, attributes: list[Formula]) -> list[Formula]:
    """The formulas that labels need; those of rewards are not in the text of a chain."""
    texts = [objective.complete, *(label.text for label in objective.labels)]
    words = set(re.findall(r"\w+", " ".join(texts)))
    return [formula for formula in attributes if formula.name in words]


def _start_key(combination: Combination) -> list[str]:
    """The weights of several initial states, which the language has no place for."""
    space, start = combination.space, combination.objective.start
    return [
        f"starts with probability {float(start[place])!r} at {space.locations[place]}"
        for place in np.flatnonzero(start).tolist()
    ]


def _render(combination: Combination, starts: Bools, *, with_objective: bool) -> str:
    writer = StepWriter(combination)
    fixed_start = int(np.count_nonzero(starts)) == 1
    space = space_text(writer, starts)
    capability = capability_text(writer, fixed_start=fixed_start)
    attributes = writer.formulas.take()
    objective = objective_text(writer, fixed_start=fixed_start) if with_objective else None
    return _lines(
        "combination.prism.j2",
        combination=combination,
        space=space,
        space_attributes=attributes,
        capability=capability,
        objective=objective,
        objective_attributes=writer.formulas.take(),
        initial=None if fixed_start else _initial(writer, starts),
    )


def _lines(template: str, **content: object) -> str:
    """A template filled in, long lines broken."""
    rendered = environment().get_template(template).render(content)
    return "\n".join(_wrapped(line) for line in rendered.rstrip("\n").split("\n")) + "\n"


def _wrapped(line: str) -> str:
    """A long line broken where a sum has its terms, then at spaces; comments break where they are made."""
    if len(line) <= WIDTH or line.lstrip().startswith("//"):
        return line
    indent = " " * (len(line) - len(line.lstrip()) + 4)
    terms = _terms(line)
    lines = [terms[0], *(f"{indent}+ {term}" for term in terms[1:])]
    return "\n".join(_filled(part, indent + "  ") for part in lines)


def _filled(line: str, indent: str) -> str:
    """The line broken at spaces, but not within a box nor between a case and its value."""
    kept = _UNBROKEN.sub(lambda found: found[0].replace(" ", _GLUE), line)
    filled = textwrap.fill(
        kept, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )
    return filled.replace(_GLUE, " ")


def _terms(line: str) -> list[str]:
    """The line cut at each ` + ` outside parentheses."""
    depths = list(accumulate((char == "(") - (char == ")") for char in line))
    cuts = [cut.start() for cut in re.finditer(r" \+ ", line) if depths[cut.start()] == 0]
    starts = [0, *(cut + 3 for cut in cuts)]
    return [line[start:stop] for start, stop in zip(starts, [*cuts, len(line)], strict=True)]


def _initial(writer: StepWriter, starts: Bools) -> str:
    terms = [predicate(writer.space, starts), f"{MODE_VARIABLE}={writer.combination.capability.initial_mode}"]
    # A variable of one value has a range of two, as PRISM-games wants it.
    for name, column in zip(writer.space.variable_names, writer.space.valuations.T, strict=True):
        if column.max() == 0:
            terms.append(f"{name}=0")
    return bare(conjunction(terms))


@lru_cache(maxsize=1)
def environment() -> jinja2.Environment:
    """Return the templates, loaded once."""
    sources = {
        entry.name: entry.read_text(encoding="utf-8")
        for entry in files("prism_templates").iterdir()
        if entry.name.endswith(".j2")
    }
    return jinja2.Environment(
        loader=jinja2.DictLoader(sources),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
