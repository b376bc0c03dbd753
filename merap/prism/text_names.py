"""Names in PRISM text: those of the program, but where an engine can't read one."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from merap.program.form import Program
from merap.program.names import KEYWORDS, unique_name
from merap.program.renaming import renamed


@dataclass(frozen=True)
class TextNames:
    """What text calls that which has another name in the program; all else keeps its name.

    Attributes:
        variables: name in the program -> name in text.
        actions: likewise.
        processes: likewise.
    """

    variables: Mapping[str, str]
    actions: Mapping[str, str]
    processes: Mapping[str, str]

    @property
    def back(self) -> TextNames:
        """Name in text -> name in the program."""
        kinds = (self.variables, self.actions, self.processes)
        return TextNames(*({new: name for name, new in names.items()} for names in kinds))

    def header(self) -> tuple[str, ...]:
        """Return a line of comment for each name that text has changed."""
        kinds = (("variable", self.variables), ("action", self.actions), ("module", self.processes))
        return tuple(
            f"the {kind} {name} is written {written}"
            for kind, names in kinds
            for name, written in names.items()
        )


def text_names(program: Program) -> TextNames:
    """Return the names of a program that text has to change.

    An action `go#1.2` becomes `go_1_2`; a keyword of an engine, or a name that is taken then, gets
    underscores behind it.
    """
    variables = [one.name for one in program.variables]
    processes = [one.name for one in program.processes]
    taken = {*variables, *program.actions, *processes}
    return TextNames(_changed(variables, taken), _changed(program.actions, taken), _changed(processes, taken))


def _changed(names: Collection[str], taken: set[str]) -> dict[str, str]:
    changed = {}
    for name in names:
        written = re.sub(r"\W", "_", name)
        if written != name or name in KEYWORDS:
            changed[name] = unique_name(f"{name}_" if written == name else written, taken)
            taken.add(changed[name])
    return changed


def with_text_names(program: Program, names: TextNames) -> Program:
    """Return the program as text names it."""
    return renamed(program, names.variables, names.actions, names.processes)
