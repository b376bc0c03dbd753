"""Names that engines can't read, in text; Storm's build of the text is the other route."""

from __future__ import annotations

from pathlib import Path

from merap.prism.program_text import render_program
from merap.prism.text_names import text_names, with_text_names
from merap.program.exploration import explore
from merap.program.expressions import parse
from merap.program.form import Process, Program, RewardItem, RewardStructure, boolean, integer
from tests.support.explored import choices_of
from tests.support.programs import command, outcome, start
from tests.support.storm_choices import build, choices_of_storm

# names that an engine reserves, and one that is taken where another would go
CLOCK = Process(
    "player",
    "environment",
    (integer("rate", 0, 3), integer("rate_", 0, 1), boolean("F")),
    (
        command("go#1.2", "rate < 3 & !F", [outcome("1/3", rate="rate + 1"), outcome("2/3", F="rate_ = 1")]),
        command("go_1_2", "rate > 1", [outcome("1", rate_="1 - rate_")]),
        command("label", "F", [outcome("1", F="false")]),
        command("label", "rate = 3 & !F", [outcome("1", rate="0")]),
    ),
    start(rate="0", rate_="0", F="false"),
)
PROGRAM = Program(
    "clock",
    (CLOCK,),
    {"goal": parse("rate = 3")},
    {"r": RewardStructure((RewardItem(parse("rate"), actions=frozenset({"go#1.2"})),))},
)


def test_text_is_legal_and_says_what_it_has_renamed(tmp_path: Path) -> None:
    text = render_program(PROGRAM)
    assert text.splitlines()[:7] == [
        "// clock",
        "// the variable rate is written rate__",
        "// the variable F is written F_",
        "// the action go#1.2 is written go_1_2_",
        "// the action label is written label_",
        "// the module player is written player_",
        "mdp",
    ]
    (tmp_path / "model.prism").write_text(text, encoding="utf-8")
    names = text_names(PROGRAM)
    theirs = build(tmp_path / "model.prism", {})
    found = choices_of(PROGRAM, explore(PROGRAM))
    own = names.back.actions
    read = choices_of_storm(with_text_names(PROGRAM, names), theirs)
    assert read.keys() == found.keys()
    for state, choices in read.items():
        assert {(own.get(name or "", name), successors) for name, successors in choices} == set(found[state])
