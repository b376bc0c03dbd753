"""Compare our exploration of PRISM files that others wrote with Storm: scripts.bench foreign FOLDER.

Constants without a value get small ones. Each file is compared twice: with Storm's build of it as it stands,
by valuations, actions and probabilities, and with Storm's build of the text that we write of it, rewards
included.
"""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Mapping
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import stormpy
import typer

from merap.checker.prism_model import PrismModel
from merap.checker.prism_reading import prism_file, read_prism
from merap.checker.prism_scan import readable_text
from merap.checker.storm import build_text
from merap.errors import MerapError
from merap.mdp.comparison import compare
from merap.prism.program_text import render_program
from merap.prism.text_names import text_names, with_text_names
from merap.program.arrays import tabular
from merap.program.closing import closed
from merap.program.completion import completed, enabled
from merap.program.exploration import Exploration, explore
from merap.program.expressions import Constant, Value, fold, negation
from merap.program.form import Program
from merap.program.names import unique_name
from merap.program.unique_actions import ambiguous_actions, unique_actions
from scripts.bench.tables import Json, cell, timed, write_figures

SUFFIXES = (".nm", ".prism", ".pm", ".templ")
SMALL: Mapping[str, Value] = {"int": Fraction(2), "double": Fraction(1, 2), "bool": True}
DIGITS = 12
# Larger models are compared by their numbers of states, choices and branches only.
MOST_STATES = 20_000
COLUMNS = {
    "file": "file",
    "states": "states",
    "choices": "choices",
    "split": "actions split",
    "ours": "ours [s]",
    "storm": "Storm [s]",
    "result": "result",
}
Valuation: TypeAlias = tuple[int, ...]
# Valuation -> how often it has a choice of an action with some successors.
Choices: TypeAlias = dict[Valuation, Counter[tuple[str, frozenset[tuple[Valuation, float]]]]]


def foreign(
    folder: Annotated[Path, typer.Argument(help="Folder with PRISM files, and folders of them.")],
    json_file: Json = None,
) -> None:
    """Explore PRISM files of others, side by side with Storm."""
    paths = sorted(path for path in folder.rglob("*") if path.suffix in SUFFIXES and path.is_file())
    rows = []
    for path in paths:
        rows.append(row(path, folder))
        print(", ".join(f"{heading}: {cell(rows[-1][key])}" for key, heading in COLUMNS.items()))
    counts = Counter(row["result"].partition(":")[0] for row in rows)
    print(", ".join(f"{count} {result}" for result, count in counts.items()))
    write_figures(json_file, rows)


def row(path: Path, folder: Path) -> dict[str, Any]:
    """Return what comes of a file; what is refused says why."""
    found: dict[str, Any] = dict.fromkeys(COLUMNS) | {"file": str(path.relative_to(folder))}
    try:
        model = read_prism(path)
        values = small_values(model)
        program = closed(model.program, values)
        found["ours"], explored = timed(lambda: explore(program))
        found |= {"states": len(explored.codes), "split": len(ambiguous_actions(explored))}
        found["storm"], built = timed(lambda: storm_build(path, values))
        found["choices"] = built.nr_choices
        found["result"] = (
            difference(program, explored, built) or text_difference(program, explored) or "equal"
        )
    except MerapError as error:
        found["result"] = f"refused: {error}"
    except RuntimeError as error:
        found["result"] = f"Storm refused: {' '.join(str(error).split())}"
    return found


def small_values(model: PrismModel) -> dict[str, Value]:
    """Return a value for every open constant: 2, 1/2 or true, or the least one of a hole."""
    values = {}
    for name, of in model.constants.items():
        least = fold(model.definitions.get(f"{name}_MIN", Constant(SMALL[of])), {})
        values[name] = least.value if isinstance(least, Constant) else SMALL[of]
    return values


def storm_build(path: Path, values: Mapping[str, Value]) -> Any:
    """Return stormpy's model of a file as it stands."""
    options = stormpy.BuilderOptions(build_full=True)
    options.set_build_state_valuations(True)
    options.set_build_choice_labels(True)
    with tempfile.TemporaryDirectory() as temporary:
        given = Path(temporary) / "model.prism"
        given.write_text(readable_text(prism_file(path)), encoding="utf-8")
        program = stormpy.parse_prism_program(given, prism_compatibility=True, simplify=False)
    if values:
        constants = ",".join(f"{name}={str(value).lower()}" for name, value in values.items())
        program, _ = stormpy.instantiate_constants(program, constants, [])
    return stormpy.build_model(program, options=options)


def difference(program: Program, explored: Exploration, built: Any) -> str | None:
    """Return how the exploration and Storm's build of the file differ; None: not at all."""
    if len(explored.codes) != built.nr_states:
        return f"DIFFERENT: {len(explored.codes)} and {built.nr_states} states"
    if built.nr_states > MOST_STATES:
        return None
    ours, theirs = choices_of(program, explored), choices_of_storm(program, built)
    different = [state for state in ours if ours[state] != theirs.get(state)]
    return f"DIFFERENT: {len(different)} states, such as {different[0]}" if different else None


def choices_of(program: Program, explored: Exploration) -> Choices:
    """Return the choices of each state that exploration has found."""
    states = dict(
        zip(
            explored.codes.tolist(),
            map(tuple, explored.encoding.valuations(explored.codes).tolist()),
            strict=True,
        )
    )
    successors: dict[tuple[int, int], Counter[Valuation]] = {}
    branches = explored.branches
    columns = (branches.source, branches.choice, branches.target, branches.prob)
    for source, choice, target, prob in zip(*(column.tolist() for column in columns), strict=True):
        successors.setdefault((source, choice), Counter())[states[target]] += prob
    found: Choices = {state: Counter() for state in states.values()}
    for (source, number), reached in successors.items():
        choice = explored.choices[number]
        pairs = frozenset((state, round(prob, DIGITS)) for state, prob in reached.items())
        found[states[source]][choice.action if choice.labelled else "", pairs] += 1
    return found


def choices_of_storm(program: Program, built: Any) -> Choices:
    """Return the same of Storm's model; the self-loops that it gives to deadlocks are left out."""
    values = built.state_valuations
    known = {str(one.name): one for one in values.get_all_variables()}
    read = [known[one.name] for one in program.variables]
    states = [tuple(int(values.get_value(state, one)) for one in read) for state in range(built.nr_states)]
    dead = set(built.labeling.get_states("deadlock")) if "deadlock" in built.labeling.get_labels() else set()
    matrix, labels = built.transition_matrix, built.choice_labeling
    starts = [*(matrix.get_row_group_start(state) for state in range(built.nr_states)), built.nr_choices]
    found: Choices = {state: Counter() for state in states}
    for number, (first, last) in enumerate(pairwise(starts)):
        for choice in range(first, last if number not in dead else first):
            pairs = frozenset(
                (states[one.column], round(one.value, DIGITS)) for one in matrix.get_row(choice)
            )
            found[states[number]][next(iter(labels.get_labels_of_choice(choice)), ""), pairs] += 1
    return found


def text_difference(program: Program, explored: Exploration) -> str | None:
    """Return how exploration and Storm's build of our own text differ; None: not at all."""
    unique = unique_actions(program, ambiguous_actions(explored))
    last = unique_name("last", {process.name for process in unique.processes})
    whole = completed(unique, negation(enabled(unique)), last)
    text = render_program(whole)
    named = with_text_names(whole, text_names(whole))
    found, storm = explore(named), build_text(text, program.name)
    for reward in (None, *named.rewards):
        theirs = storm.mdp("default" if reward == "" else reward)  # so Storm calls the one without a name
        outcome = compare(tabular(named, found, reward=reward), theirs)
        if not outcome.same:
            return f"DIFFERENT in text: {'; '.join(outcome.differences)}"
    return None
