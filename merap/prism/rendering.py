"""Combinations as PRISM text: readable, deterministic, valid for Storm and for PRISM-games."""

from __future__ import annotations

from functools import lru_cache
from importlib.resources import files

import jinja2
import numpy as np

from merap.concerns.combination import Combination
from merap.mdp.model import Bools
from merap.prism.capability_text import capability_text
from merap.prism.location_text import predicate
from merap.prism.objective_text import objective_text
from merap.prism.space_text import space_text
from merap.prism.step_text import StepWriter


def render(combination: Combination) -> str:
    """The PRISM model of a combination: modules `space`, `capability` and `objective`.

    The text depends on the combination alone: same input, same bytes.
    """
    return _render(combination, combination.objective.start > 0, with_objective=True)


def render_pair(combination: Combination, starts: Bools) -> str:
    """The PRISM model of environment and capability alone, for every objective to be attached to.

    Args:
        combination: whose environment and capability are rendered; its objective is not.
        starts: bool [P], all locations an episode may begin in under any objective.
    """
    return _render(combination, starts, with_objective=False)


def _render(combination: Combination, starts: Bools, *, with_objective: bool) -> str:
    writer = StepWriter(combination)
    fixed_start = int(np.count_nonzero(starts)) == 1
    space = space_text(writer, starts)
    capability = capability_text(writer, fixed_start=fixed_start)
    attributes = writer.take_attributes()
    objective = objective_text(writer, fixed_start=fixed_start) if with_objective else None
    rendered = (
        _environment()
        .get_template("combination.prism.j2")
        .render(
            combination=combination,
            space=space,
            space_attributes=attributes,
            capability=capability,
            objective=objective,
            objective_attributes=writer.take_attributes(),
            initial=None if fixed_start else _initial(writer, starts),
        )
    )
    return rendered.rstrip("\n") + "\n"


def _initial(writer: StepWriter, starts: Bools) -> str:
    mode = writer.combination.capability.initial_mode
    return f"{predicate(writer.space, starts)} & mode={mode}"


@lru_cache(maxsize=1)
def _environment() -> jinja2.Environment:
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
