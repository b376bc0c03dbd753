"""Fill in a user's template: constants by value, parameters as open constants of the text."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction

import jinja2
from jinja2 import meta
from jinja2.sandbox import SandboxedEnvironment

from merap.errors import InputError
from merap.program.expressions import Value, render_constant


class BranchingError(Exception):
    """A template asks for the value of a parameter that has none; its name is the message."""


class _Open(jinja2.StrictUndefined):
    """A parameter without a value: it can be written, as its name, and nothing else."""

    def __str__(self) -> str:  # type: ignore[override]
        return str(self._undefined_name)


def template_names(template: str) -> frozenset[str]:
    """Return the names that a template reads.

    Raises:
        InputError: a syntax error; names the line.
    """
    try:
        return frozenset(meta.find_undeclared_variables(_ENVIRONMENT.parse(template)))
    except jinja2.TemplateSyntaxError as error:
        raise _syntax_error(error) from error


def _syntax_error(error: jinja2.TemplateSyntaxError) -> InputError:
    return InputError(f"the template has a syntax error: {error.message}", line=error.lineno)


def fill_in_template(template: str, values: Mapping[str, Value], open_: frozenset[str]) -> str:
    """Return the text of a template.

    Args:
        template: as the user has written it.
        values: name -> value.
        open_: parameters that have no value; they are written as their names.

    Raises:
        BranchingError: more is done with an open parameter than to write it.
        InputError: a name is unknown, or the template fails; names the line where it is known.
    """
    names: dict[str, object] = {
        name: int(value) if not isinstance(value, bool) and value.denominator == 1 else value
        for name, value in values.items()
    }
    names |= {name: _Open(name=name) for name in open_}
    try:
        return _ENVIRONMENT.from_string(template).render(names)
    except jinja2.TemplateSyntaxError as error:
        raise _syntax_error(error) from error
    except jinja2.UndefinedError as error:
        for name in sorted(open_):
            if f"'{name}' is undefined" in str(error.message):
                raise BranchingError(name) from error
        raise InputError(f"the template can't be filled in: {error.message}", line=_line(error)) from error
    except (jinja2.TemplateError, ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise InputError(f"the template can't be filled in: {error}", line=_line(error)) from error


def _line(error: BaseException) -> int | None:
    """Return the line of the template that was being filled in."""
    line, trace = None, error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == "<template>":
            line = trace.tb_lineno
        trace = trace.tb_next
    return line


def _written(value: object) -> object:
    """Return what stands for a value in text."""
    if isinstance(value, Fraction):
        return f"({render_constant(value)})"
    return render_constant(value) if isinstance(value, bool) else value


_ENVIRONMENT = SandboxedEnvironment(
    undefined=jinja2.StrictUndefined,
    finalize=_written,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
    autoescape=False,
)
