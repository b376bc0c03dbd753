"""What the text of a combination can't say is refused before a checker gets it."""

from __future__ import annotations

from pathlib import Path

import pytest

from merap.checker.combination_model import export_combination
from merap.checker.verdicts import verify
from merap.errors import ModelError
from merap.families.loading import load_case

QUEUE = """\
case: queue
capability:
  actions:
    take: {requires: "length > 0"}
    rest: {}
  processes:
    length:
      range: [0, 4]
      initial: 4
      changes:
        - {action: take, set: "length - 1"}
        - {set: [{value: "min(length + 1, 4)", probability: 0.25}, {otherwise: length}]}
objective:
  horizon: 9
  rewards: [{value: "-length"}]
"""
UNSOUND = [
    ('"length > 0"', '"4 / length > 0"', "the guard of [take] is undefined in state (length=0, done=false)"),
    ('"-length"', '"-1 / length"', "a reward is undefined in state (length=0, done=false)"),
    ('"length - 1"', '"length / 2"', "[take] of length makes length no whole number in state (length=1, "),
    (
        '"length - 1"',
        '"length - 2"',
        "[take] of length makes length -1, allowed is 0..4, in state (length=1, ",
    ),
    ("{otherwise: length}", "{value: length, probability: 0.65}", "sum to 0.9, not 1, in state (length="),
    (
        "rest: {}",
        'rest: {requires: "length > 0"}',
        "state (length=0, done=false) can be reached and has no act",
    ),
]


@pytest.mark.parametrize(("old", "new", "message"), UNSOUND)
def test_what_is_unsound_is_refused_in_the_words_of_the_case(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    """Storm builds the first three without a word: a text has some value where there is none."""
    assert QUEUE.count(old) == 1
    (tmp_path / "case.yaml").write_text(QUEUE.replace(old, new), encoding="utf-8")
    combination = load_case(tmp_path).combination("default.default.default")
    with pytest.raises(ModelError) as raised:
        list(verify([combination]))
    assert str(raised.value).startswith("default.default.default: ")
    assert message in str(raised.value)
    with pytest.raises(ModelError):
        export_combination(combination, tmp_path / "model.umb")
    assert not (tmp_path / "model.umb").exists()
