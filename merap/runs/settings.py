"""Settings from a file and from `key=value` words, checked against `TrainingConfig`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from merap.concerns.yaml_file import read_document, read_value
from merap.errors import InputError
from merap.learning.config import TrainingConfig

MAX_SHOWN = 100


def read_config(
    file: Path | None, words: Sequence[str], base: TrainingConfig | None = None, **given: Any
) -> TrainingConfig:
    """Read the settings of a run; later sources win: defaults or base, file, words, options.

    Args:
        file: a YAML mapping of settings.
        words: `key=value` each, the value in YAML.
        base: settings that hold where none are given; None: the defaults.
        **given: settings from options of their own; None for those not given.

    Raises:
        InputError: an unknown setting or a value that is not allowed; names it.
    """
    settings: dict[str, Any] = {} if base is None else base.model_dump()
    if file is not None:
        settings |= _checked(read_document(file).data, str(file))
    for word in words:
        source = f"--set {word}" if len(word) <= MAX_SHOWN else f"--set {word[:MAX_SHOWN]}..."
        settings |= _checked(_parsed(word, source), source)
    options = {name: value for name, value in given.items() if value is not None}
    settings |= _checked(options, "options")
    return TrainingConfig(**settings)


def _parsed(word: str, source: str) -> Mapping[str, Any]:
    key, equals, text = word.partition("=")
    if not equals:
        raise InputError(f"expected key=value, got {word!r}", source="--set")
    return {key: read_value(text, source, key)}


def _checked(settings: Mapping[Any, Any], source: str) -> Mapping[str, Any]:
    """Return the same, if each is a setting with an allowed value."""
    try:
        TrainingConfig(**{str(key): value for key, value in settings.items()})
    except InputError as error:
        raise InputError(error.message, source=source, key=error.key) from error
    return settings
