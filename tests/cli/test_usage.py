"""Wrong words on the command line: one line that names the option, what it was given and what is allowed."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

import pytest

from tests.support.command_line import merap, refused
from tests.support.paths import MODELS
from tests.support.trained_runs import ONE_OF_THREE, contents

LAKE = MODELS / "frozen-lake"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("trian", "merap: No such command 'trian'. Did you mean 'train'?; see merap --help"),
        ("--sedd", "merap: No such option: --sedd; see merap --help"),
        ("validate", "merap validate: Missing argument 'case'; see merap validate --help"),
        ("render CASE", "merap render: Missing option '--out' / '-o'; see merap render --help"),
        (
            "validate CASE more",
            "merap validate: Got unexpected extra argument(s) (more); see merap validate --help",
        ),
        ("verify CASE --json", "merap: Option '--json' requires an argument; see merap --help"),
        ("verify CASE --sample 0", "--sample: expected a number of at least 1, got '0'"),
        ("verify CASE --sample few", "--sample: expected a whole number, got 'few'"),
        ("verify CASE --sample 1e3", "--sample: expected a whole number, got '1e3'"),
        ("show CASE -o x.png --optimum way", "--optimum: 'way' is not one of 'none', 'policy', 'path'"),
        ("difference CASE --w1 inf", "--w1: expected a number of at most 1000000000.0, got 'inf'"),
        ("difference CASE --w2 -1", "--w2: expected a number of at least 0.0, got '-1'"),
        ("export-policy RUN -o p --format xml", "--format: 'xml' is not one of 'csv', 'npz', 'prism'"),
        ("adapt RUN --reset no", "--reset: 'no' is not one of 'episodes', 'return_to_start', 'none'"),
        ("adapt RUN --steps 0", "--steps: expected a number of at least 1, got '0'"),
        ("adapt RUN --slip much", "--slip: expected a number, got 'much'"),
        ("serve LAKE --slip 1", "the probability to slip must be in [0, 1), it is 1.0"),
        ("serve LAKE --slip -0.1", "the probability to slip must be in [0, 1), it is -0.1"),
        ("serve LAKE --slip nan", "the probability to slip must be in [0, 1), it is nan"),
        ("serve LAKE --port 70000", "a port is a number from 0 to 65535, not 70000"),
        (
            "knowledge shw",
            "merap knowledge: No such command 'shw'. Did you mean 'show'?; see merap knowledge --help",
        ),
        ("knowledge show x --db y", "run: expected a whole number, got 'x'"),
        ("train -o RUN", "merap train: a case is missing; see merap train --help"),
    ],
)  # fmt: skip
def test_wrong_usage_is_one_line(
    words: str, line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    places = {"CASE": ONE_OF_THREE, "LAKE": LAKE, "RUN": tmp_path / "run"}
    assert refused(*(places.get(word, word) for word in words.split())) == f"error: {line}"
    assert contents(tmp_path) == {}


@pytest.mark.parametrize("words", [[], ["knowledge"]])
def test_without_a_verb_the_help_is_shown(words: list[str]) -> None:
    done = merap(*words)
    assert (done.returncode, done.stderr) == (2, "")
    assert done.stdout.startswith(f"Usage: {' '.join(['merap', *words])} [OPTIONS] COMMAND [ARGS]...")


def test_the_version_is_told() -> None:
    done = merap("--version")
    assert (done.returncode, done.stdout) == (0, f"merap {version('merap')}\n")


def test_help_says_what_slip_may_be() -> None:
    """The check and the help agree: 1 is not allowed."""
    for verb in ("adapt", "serve"):
        text = " ".join(merap(verb, "--help").stdout.split())
        assert "Probability that an action does nothing: in [0, 1)." in text
        assert "0<=x<=1" not in text


@pytest.mark.parametrize("verb", ["verify", "render", "export"])
def test_too_many_combinations_are_refused_with_the_way_out(verb: str, tmp_path: Path) -> None:
    out = ["-o", tmp_path / "out"] if verb != "verify" else []
    line = refused(verb, MODELS / "paper-grid" / "rq1-4.yaml", *out)
    assert line.endswith(
        "paper_rq1_4 has 27027 combinations, too many to enumerate (limit 10000); take some at random, "
        "such as --sample 100"
    )


def test_a_case_without_the_system_met_takes_another_one(tmp_path: Path) -> None:
    """The first online system; a combination where there is none."""
    text = ONE_OF_THREE.read_text()
    none, other = tmp_path / "none.yaml", tmp_path / "other.yaml"
    none.write_text(text[: text.index("online:")])
    other.write_text(text.replace("  met:", "  robot:"))
    for case, name in ((none, "open.no_entry_r3c4.middle"), (other, "robot")):
        for words in (("show", case, "-o", tmp_path / f"{case.stem}.png"), ("difference", case)):
            done = merap(*words)
            assert done.returncode == 0, done.stderr
            assert done.stderr == (
                "warning: paper_rq1_3 has no online system 'met'; without --system this one is taken: "
                f"{name}\n"
            )
    assert "'met'" in refused("show", none, "--system", "met", "-o", tmp_path / "met.png")


def test_counts_agree_with_their_nouns() -> None:
    counts, note = merap("validate", LAKE).stdout.splitlines()
    assert counts == (
        "frozen_lake: 16 locations, 4 actions; 30 combinations of 15 x 2 x 1 configurations; "
        "online systems: met"
    )
    assert note == (
        "note: capability.parameters.grip: without a domain only the values of the support are hypotheses; "
        "give one as {probability: [least, greatest]}"
    )
