"""Check the properties of any PRISM model, for one or many values of its open constants."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from merap.checker.attempts import Attempt, Status, attempt, for_json
from merap.checker.constants import Value, combinations, read_constants, require_known, shown
from merap.checker.exchange import Answer, ForeignModel
from merap.checker.prism_model import ConstantType
from merap.checker.prism_text import CheckableText, checkable_text
from merap.checker.process import CheckingProcess, OverTimeError
from merap.checker.properties import TIMEOUT
from merap.checker.property_expressions import as_tree
from merap.checker.property_file import (
    Property,
    PropertyFile,
    chosen,
    names_in,
    read_properties,
    with_constants,
)
from merap.concerns.arguments import as_path
from merap.errors import InputError

ARCHIVE = ".umb"
Given: TypeAlias = Mapping[str, object] | Sequence[str]


@dataclass(frozen=True)
class Result:
    """One property of one model, with values of the constants that it depends on.

    Attributes:
        name: the property's name, else its text.
        text: of the property.
        constants: open constant -> value, as text.
        engine: the one that answered.
        value: over the initial states, also of a property with a bound; None if there is none.
        lower: sound lower bound of the value; None if the engine gives none.
        upper: sound upper bound of the value.
        holds: None where the property asks for a value.
        method: `doubles`, whose error the bounds enclose, or `fractions`; None without an answer.
        seconds: that the answer took, without building the model.
        status: `unsupported` where the engine can't answer this kind of property, `timeout` where
            it has no answer in time.
        reason: why there is no answer.
    """

    name: str
    text: str
    constants: Mapping[str, str]
    engine: str
    value: float | None
    lower: float | None
    upper: float | None
    holds: bool | None
    method: str | None
    seconds: float
    status: Status
    reason: str | None = None

    @property
    def precision(self) -> float | None:
        """Half the distance of the bounds; None where there are none."""
        if self.lower is None or self.upper is None:
            return None
        return 0.0 if self.lower == self.upper else (self.upper - self.lower) / 2

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {name: for_json(value) for name, value in asdict(self).items()}


@dataclass(frozen=True)
class CheckedProperties:
    """The results for a model, and what is to be said about it.

    Attributes:
        results: in the order of the constants' values, then of the properties.
        notes: of repaired deadlocks, several initial states, decimals that are compared.
    """

    results: tuple[Result, ...]
    notes: tuple[str, ...]


def check(
    model: str | PathLike[str],
    properties: str | PathLike[str],
    *,
    constants: Given = (),
    only: Sequence[str] = (),
    timeout: float = TIMEOUT,
) -> CheckedProperties:
    """Check properties of a model in PRISM's language, or of an archive.

    Args:
        model: a file of PRISM text (a Markov chain in discrete time or an MDP), or `.umb`.
        properties: a file of properties, or the text of some.
        constants: values for the constants that model and properties leave open: `{"n": [1, 2, 3]}`, or
            texts such as `n=1:3` and `p=0.1:0.2:0.9` (low:step:high). Every combination is checked.
        only: names or numbers of properties; all by default.
        timeout: seconds for building a model, and for each property.

    Raises:
        InputError: a file is missing or wrong, or a constant has no value.
        ModelError: a model is unsound; names state and action.
        EngineError: the engine failed.
    """
    path = as_path(model, "model")
    file = chosen(_properties(properties), tuple(only))
    text = None if path.suffix == ARCHIVE else _text(path)
    values = read_constants(constants if not isinstance(constants, Mapping) else _texts(constants))
    task = _Task(path, text, file, values)
    with CheckingProcess(timeout) as process:
        notes = dict.fromkeys(() if text is None else text.warnings)
        results = list(_results(process, task, notes))
    return CheckedProperties(tuple(results), tuple(notes))


def _texts(constants: Mapping[str, object]) -> list[str]:
    found = []
    for name, given in constants.items():
        values = list(given) if isinstance(given, Sequence) and not isinstance(given, str) else [given]
        texts = (str(value).lower() if isinstance(value, bool) else str(value) for value in values)
        found.append(f"{name}=" + ",".join(texts))
    return found


def _properties(given: str | PathLike[str]) -> PropertyFile:
    path = Path(given)
    if isinstance(given, str) and ("[" in given or "\n" in given or not path.suffix) and not _is_file(path):
        return read_properties(given)
    return read_properties(_content(path), str(path))


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a text can be too long for a name
        return False


def _text(path: Path) -> CheckableText:
    try:
        return checkable_text(_content(path))
    except InputError as error:
        raise InputError(error.message, source=str(path), line=error.line) from error


def _content(path: Path) -> str:
    try:
        return path.read_bytes().decode(errors="replace")  # PRISM reads comments in any encoding
    except OSError as error:
        raise InputError(f"can't be read: {error.strerror or error}", source=str(path)) from error


class _Task(NamedTuple):
    path: Path
    text: CheckableText | None
    file: PropertyFile
    values: Mapping[str, tuple[Value, ...]]


def _results(process: CheckingProcess, task: _Task, notes: dict[str, None]) -> Iterator[Result]:
    of_model: Mapping[str, ConstantType | None] = {} if task.text is None else task.text.constants
    of_file = {name: kind for name, (kind, tree) in task.file.constants.items() if tree is None}
    require_known(task.values, [*of_model, *of_file])
    for chosen_values in combinations(task.values, of_model, str(task.path)):
        listed = ",".join(f"{name}={shown(value)}" for name, value in chosen_values.items())
        name = f"{task.path} ({listed})" if listed else str(task.path)
        text = None if task.text is None else task.text.text
        process.begin(ForeignModel(name, text, str(task.path), listed))
        late = None
        try:
            notes |= dict.fromkeys(process.finish())
        except OverTimeError as error:
            late = Attempt(Answer(), "timeout", str(error))
        for given in task.file.properties:
            needed = _needed(given, task.file) - of_model.keys()
            own = {name: kind for name, kind in of_file.items() if name in needed}
            for values in combinations(task.values, own, "the properties"):
                instance = _instance(given, task.file, chosen_values | values)
                yield _result(process, instance, late, chosen_values | values)


def _needed(given: Property, file: PropertyFile) -> set[str]:
    """Return the names of constants that a property reads, through others too."""
    found: set[str] = set()
    waiting = names_in(given.tree)
    while waiting:
        name = waiting.pop()
        if name in file.constants and name not in found:
            found.add(name)
            definition = file.constants[name][1]
            waiting |= set() if definition is None else names_in(definition)
    return found


def _instance(given: Property, file: PropertyFile, values: Mapping[str, Value]) -> Property:
    defined = {name: tree for name, (_, tree) in file.constants.items() if tree is not None}
    put_in = {**defined, **{name: as_tree(value) for name, value in values.items()}}
    return Property(given.name, given.text, with_constants(given.tree, put_in), given.line)


def _result(
    process: CheckingProcess, given: Property, late: Attempt | None, constants: Mapping[str, Value]
) -> Result:
    started = time.perf_counter()
    found = late or attempt(lambda: process.check(given))
    answer = found.answer
    return Result(
        name=given.name,
        text=given.text,
        constants={name: shown(value) for name, value in constants.items()},
        engine="storm",
        value=answer.value,
        lower=answer.lower,
        upper=answer.upper,
        holds=answer.holds,
        method=None if found.status != "ok" else "fractions" if answer.exact else "doubles",
        seconds=time.perf_counter() - started,
        status=found.status,
        reason=found.reason,
    )
