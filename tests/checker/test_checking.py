"""Models of other people: constants, files of properties, repaired deadlocks, refusals."""

from __future__ import annotations

from fractions import Fraction
from math import comb
from pathlib import Path

import pytest

from merap.checker.checking import Result, check
from merap.checker.experiment import lines, tables
from merap.checker.storm import build_text
from merap.errors import InputError, MerapError, ModelError
from tests.support.dice import CLIMB

pytestmark = pytest.mark.process


@pytest.fixture
def climb(tmp_path: Path) -> Path:
    path = tmp_path / "climb.prism"
    path.write_text(CLIMB, encoding="utf-8")
    return path


def one(model: Path, text: str, *constants: str) -> Result:
    (result,) = check(model, text, constants=constants).results
    return result


def at_least(successes: int, tries: int, p: Fraction) -> Fraction:
    return sum(
        (comb(tries, n) * p**n * (1 - p) ** (tries - n) for n in range(successes, tries + 1)), Fraction(0)
    )


def test_every_combination_of_constants_has_its_value(climb: Path) -> None:
    done = check(
        climb,
        'const int k; "soon": Pmax=? [F<=k "top"]; Pmax=? [X high]',
        constants={"N": [2, 3], "p": "1/3", "k": range(3, 6)},
    )
    soon = [one for one in done.results if one.name == "soon"]
    assert [(one.constants["N"], one.constants["k"]) for one in soon] == [(n, k) for n in "23" for k in "345"]
    for result in soon:
        expected = at_least(int(result.constants["N"]), int(result.constants["k"]), Fraction(1, 3))
        assert result.value == pytest.approx(float(expected), abs=1e-12)
    # the second property does not depend on k, and is checked once for each N
    assert len(done.results) == 8
    found = tables(done.results)
    assert [(table.constants, len(table.rows)) for table in found] == [(("N", "k"), 6), (("N",), 2)]
    constant, drawn = lines(done.results)
    assert constant == "k"
    assert list(drawn) == ["soon, N=2", "soon, N=3"]
    assert [place for place, _ in drawn["soon, N=2"]] == [3, 4, 5]


def test_deadlocks_are_repaired_aloud_and_commands_need_no_action(climb: Path) -> None:
    done = check(climb, 'Pmin=? [F "deadlock"]; Pmax=? [F "top"]', constants=["N=2,p=0.5"])
    assert done.notes == ("1 state has no action, as (x=2): a loop is added, as PRISM does",)
    assert [one.value for one in done.results] == [0, pytest.approx(1)]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        # an unnamed structure is the first one; steps until three successes of 1/2
        ('Rmin=? [F "top"]', 6),
        ('Rmin=? [(F "top")]', 6),
        ("R{2}min=? [(F x=3)]", 12),
        ('R{"double"}min=? [C<=1]', 2),
        ("Pmin=? [G<=3 x<2]", 0.5),
        ("Pmax=? [G<=3 high]", 0),
        ("Pmax=? [F>=2 x=0]", 1),
        ("Pmin=? [G>2 high]", 0),
        ("1-Pmax=? [F<=2 high]", 0.75),
        ("ceil(Pmax=? [F<=2 high])+2", 3),
        ("filter(max, Pmax=? [F<=1 x=3], x<3)", 0.5),
        ("filter(avg, Pmax=? [F<=1 x=3], x>=2)", 0.75),
        ("filter(count, Pmax>=0.5 [F<=1 x=3])", 2),
        ("Pmax=? [F<=1 x=3 {x=2}]", 0.5),
        ("Pmax=? [F<=1 x=3 {x>0}{min}]", 0),
        ("filter(sum, x, true)", 6),
        ("Pmax=? [F<=1 mod(x-4,2)=1]", 0.5),
        ("Pmax=? [F<=(N-1) x=N-1]", 0.25),
        ('label "one" = x=1; Pmax=? [F<=1 "one"]', 0.5),
        ('"a": Pmax=? [F<=1 x=1]; "a"+0.25', None),
    ],
)
def test_forms_of_prism_that_storm_lacks(climb: Path, text: str, value: float | None) -> None:
    results = check(climb, text, constants=["N=3,p=0.5"]).results
    if value is None:
        assert [one.value for one in results] == [0.5, 0.75]
        return
    assert results[-1].status == "ok"
    assert results[-1].value == pytest.approx(value, abs=1e-9)


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("P>=0.5 [G<=3 x<2]", True),
        ("P>0.5 [G<=3 x<2]", False),
        ("P>=0.5 [F>=1 high]", False),
        ("<<*>> P>=0.25 [F<=2 high]", True),
        ("[[*]] P>=0.25 [F<=2 high]", False),
        ("E [F high]", True),
        ("A [G x<3]", False),
        ("A [G<=2 x<3]", True),
        ("E [X x=1] & !(E [X high])", True),
        ("filter(forall, P<=0.5 [X x=3] <=> x<=3, x<3)", True),
        ("filter(exists, x=3)", True),
        ("0.2 < Pmax=? [F<=2 high]", True),
        ("P>=1 [F P>=0.5 [X x=1]]", False),
        ("Pmax>=1 [F Pmax>=0.5 [X x=2]]", True),
        ("high => false", True),
    ],
)
def test_truth_values(climb: Path, text: str, holds: bool) -> None:
    assert one(climb, text, "N=3,p=0.5").holds is holds


def test_a_result_says_how_sure_it_is(climb: Path) -> None:
    bounded = one(climb, "Rmax=? [C<=2]", "N=3,p=0.5")
    assert bounded.method == "doubles"
    assert bounded.lower is not None
    assert bounded.upper is not None
    assert bounded.lower <= 2 <= bounded.upper
    assert bounded.precision is not None
    assert bounded.precision < 1e-9
    assert bounded.seconds > 0
    exact = one(climb, "P>=0.1 [F<=1 x=1]", "N=3,p=0.1")
    assert exact.holds is False  # by the policy that waits
    refused = one(climb, "multi(Pmax=? [F x=1], Pmax=? [F x=2])", "N=3,p=0.1")
    assert (refused.status, refused.value, refused.method) == ("unsupported", None, None)
    assert "multi(..)" in str(refused.reason)


def test_a_markov_chain_with_several_initial_states(tmp_path: Path) -> None:
    path = tmp_path / "chain.pm"
    path.write_text(
        """probabilistic
module chain
  s : [0..3];
  [] s<3 -> 0.5 : (s'=s+1) + 0.5 : (s'=0);
  [] s=3 -> true;
endmodule
init s<2 endinit
""",
        encoding="utf-8",
    )
    done = check(path, "P=? [F<=3 s=3]")
    assert done.notes == ("2 initial states: values are means over them, truths hold in all",)
    # from 0: 1/8; from 1: 1/4
    assert done.results[0].value == pytest.approx((1 / 8 + 1 / 4) / 2)


def test_an_archive_is_checked_too(tmp_path: Path) -> None:
    archive = tmp_path / "climb.umb"
    text = CLIMB.replace("int N", "int N = 2").replace("double p", "double p = 0.5")
    text = text.replace("[wait] x=1 -> (x'=0);", "[back] x=1 -> (x'=0);").replace(
        "endmodule", "[] x=N -> true;\nendmodule"
    )
    build_text(text, "climb").export_umb(archive)
    result = one(archive, 'Pmax=? [F<=3 "top" & x=2]')
    assert result.value == 0.5
    assert one(archive, "Pmax=? [G F x=1]").status == "unsupported"


@pytest.mark.parametrize(
    ("old", "new", "kind", "message"),
    [
        ("1-p : true", "0.25 : true", ModelError, "action (unnamed): probabilities sum to 0.75, not 1"),
        ("x<N -> p", "x<=N -> p", ModelError, "(x=3), action (unnamed) leaves the range of a variable"),
        ("mdp", "ctmc", InputError, "the model is of type ctmc, only dtmc or mdp is supported"),
        ("p : (x'=x+1)", "[0.1,0.5] : (x'=x+1)", InputError, "interval probabilities are not supported here"),
        ("endmodule", "endmodule system climb endsystem", InputError, "a `system ... endsystem` block"),
        ("x<N -> p", "x<N > p", InputError, ":7: column "),
        ("const int N", "const bool N", InputError, "N=3: the constant is of type bool"),
        (": 2;", ": x=0 ? 0/0 : 2;", MerapError, ""),
    ],
)  # fmt: skip
def test_what_storm_accepts_silently_is_refused_in_one_line(
    climb: Path, old: str, new: str, kind: type[MerapError], message: str
) -> None:
    climb.write_text(CLIMB.replace(old, new), encoding="utf-8")
    with pytest.raises(kind) as raised:
        check(climb, 'Pmax=? [F "top"]; R{"double"}min=? [F "top"]', constants=["N=3,p=0.5"])
    assert str(climb) in str(raised.value) or str(raised.value).startswith("--const")
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


def test_negative_numbers_have_prism_s_remainder(tmp_path: Path) -> None:
    """Storm's own mod(-4, 4) is 4."""
    path = tmp_path / "wheel.prism"
    path.write_text(
        "mdp\nmodule wheel\n  s : [-4..4] init -4; // mod(\n  [] true -> (s'=mod(s,mod(7, 5)+2));\n"
        "endmodule\n",
        encoding="utf-8",
    )
    assert one(path, "Pmax=? [X s=0]").value == 1


@pytest.mark.parametrize("condition", ["0.1*x<=0.3", "x/10 > 0.2", "1/3 = 0.3333333333333333333"])
def test_a_decimal_that_is_compared_is_named_with_its_line(climb: Path, condition: str) -> None:
    climb.write_text(CLIMB.replace("x>=2", condition), encoding="utf-8")
    (note, *_) = check(climb, "Pmax=? [X x=1]", constants=["N=2,p=0.5"]).notes
    assert note.startswith(f"line 4: {condition} compares decimals")


@pytest.mark.parametrize(
    ("constants", "message"),
    [
        ([], "constant 'N' has no value; give one by --const N=.."),
        (["N=3"], "constant 'p' has no value"),
        (["N=3,p=0.5,q=1"], "--const: no open constant is called 'q'; known: N, p"),
        (["N=1/2,p=0.5"], "--const: N=0.5: the constant is of type int"),
        (["N=3,p=true"], "--const: p=true: the constant is of type double"),
        (["N=3:1,p=1"], "expected low <= high and a step above 0"),
        (["N=1:0:3,p=1"], "expected low <= high and a step above 0"),
        (["N=1:100000,p=1"], "more than 10000 values"),
        (["N=a,p=1"], "'a' is neither a number nor true or false"),
        (["N"], "'N': expected name=value, as n=3 or n=1:10"),
        (["N=1", "N=2"], "constant 'N' is given twice"),
    ],
)
def test_wrong_constants_are_one_line(climb: Path, constants: list[str], message: str) -> None:
    with pytest.raises(InputError) as raised:
        check(climb, "Pmax=? [F x=1]", constants=constants)
    assert message in str(raised.value)


def test_a_file_of_properties_is_named_with_its_line(climb: Path, tmp_path: Path) -> None:
    file = tmp_path / "climb.props"
    file.write_text(
        'const int k = 2;\n// twice\n"two": Pmax=? [F<=k high]\nPmin=? [F high]\n', encoding="utf-8"
    )
    done = check(climb, file, constants=["N=3,p=0.5"], only=["two"])
    assert [(one.name, one.text, one.value) for one in done.results] == [("two", "Pmax=? [F<=k high]", 0.25)]
    assert check(climb, file, constants=["N=3,p=0.5"], only=["2"]).results[0].value == 0
    with pytest.raises(InputError, match="no property is called 'tow'; did you mean 'two'"):
        check(climb, file, constants=["N=3,p=0.5"], only=["tow"])
    file.write_text("P=? [F x=1];\nPmax=? [F x=1", encoding="utf-8")
    with pytest.raises(InputError) as raised:
        check(climb, file)
    assert (raised.value.source, raised.value.line) == (str(file), 2)
    with pytest.raises(InputError, match=r"none\.props: can't be read"):
        check(climb, tmp_path / "none.props")
    with pytest.raises(InputError, match="there are no properties"):
        check(climb, "// nothing\n")


def test_a_model_over_its_time_gives_results_without_answers(climb: Path) -> None:
    done = check(climb, "Pmax=? [F x=1]", constants=["N=3,p=0.5"], timeout=1e-6)
    assert done.results[0].status == "timeout"
    assert done.results[0].reason is not None
    assert "not done within" in done.results[0].reason
