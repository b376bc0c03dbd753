"""Models that Storm builds without a word and that are refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from merap.checker.storm import build_file, build_text
from merap.errors import InputError, MerapError, ModelError
from tests.support.walk import WALK


def changed(old: str, new: str) -> str:
    assert old in WALK
    return WALK.replace(old, new)


BROKEN = [
    (InputError, changed("endmodule", "endmodul"), 'm:7: column 1: expecting "endmodule", here: endmodul'),
    (InputError, changed("[go] x<3 ->", "[go] x<3 >"), 'm:4: column 12: expecting "->", here: [go] x<3 >'),
    (InputError, changed("[go] x<3", "[go] y<3"), "m:4: column 7: expecting <expression>, here: [go] y<3"),
    (InputError, changed("[go] x<3", "[go] x"), "m:4: expression for guard must evaluate to type 'bool'"),
    (InputError, "", "m:1: column 1: expecting <model type>"),
    (InputError, changed("mdp", "ctmc"), "m: is neither an MDP nor a discrete-time Markov chain"),
    (InputError, changed("module walk", "const int n;\nmodule walk"), "m: a constant has no value"),
    (
        ModelError,
        changed("x<3 -> 1/2", "x<3 -> 4/10"),
        "m: (x=0), action go: probabilities sum to 0.9, not 1",
    ),
    (ModelError, changed("x<3 -> 1/2", "x<3 -> -1/2"), "m: (x=0), action go has a probability of -0.5"),
    (ModelError, changed("[go] x<3", "[go] x<=3"), "m: (x=3), action go leaves the range of a variable"),
    (
        ModelError,
        changed("[go] x<3", "lit : bool init true; dim : bool init false;\n  [go] x<=3"),
        "m: (lit=1, dim=0, x=3), action go leaves the range of a variable",
    ),
    (ModelError, changed("[end] x=3", "[end] x=4"), "m: state (x=3) has no action"),
    (ModelError, changed("[rest]", "[go]"), "m: (x=0), action go is there twice"),
]


@pytest.mark.parametrize(("kind", "text", "message"), BROKEN)
def test_a_broken_model_is_refused_in_one_line(kind: type[MerapError], text: str, message: str) -> None:
    with pytest.raises(MerapError) as raised:
        build_text(text, "m")
    assert type(raised.value) is kind
    assert str(raised.value).startswith(message)
    assert "\n" not in str(raised.value)


def test_a_file_is_named_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "walk.prism"
    path.write_text(changed("-> true;", "-> tru;"), encoding="utf-8")
    with pytest.raises(InputError) as raised:
        build_file(path)
    assert raised.value.source == str(path)
    assert raised.value.line == 5
    path.write_text(WALK, encoding="utf-8")
    assert build_file(path).mdp().num_states == 4
    with pytest.raises(InputError, match="there is no such file"):
        build_file(tmp_path / "none.prism")


def test_a_markov_chain_is_built() -> None:
    chain = build_text(changed("mdp", "dtmc").replace("  [rest] x<3 -> true;\n", ""), "chain")
    assert chain.check('P=? [F<=4 "goal"]').value == 5 / 16
