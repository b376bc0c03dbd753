"""Small families of PRISM text for tests."""

from __future__ import annotations

from pathlib import Path

from merap.families.loading import load_case
from merap.families.prism_family import WrittenCase

# features: a formula, a constant with a value, an undefined one in a range, two commands of an action that
# meet, commands without an action, two modules that step together, labels and an action with our names
WALK = """\
mdp
const int N = 3;
const int top;
const double slip;
const bool lazy;
formula home = x = 0;
module walker
  x : [0..top] init 1;
  [go] x<top -> 1-slip : (x'=x+1) + slip : true;
  [go] x>1 & !lazy -> (x'=x-1);
  [] home -> (x'=1);
  [end] x=N -> (x'=0);
  [stay] true -> true;
endmodule
module timer
  late : bool init false;
  [go] true -> 0.5 : (late'=true) + 0.5 : true;
  [stay] !late -> (late'=true);
  [] late -> (late'=false);
endmodule
label "goal" = x = N;
label "done" = late;
rewards "cost" [go] true : 2; x>0 : 0.5; [] late : 1; endrewards
rewards "steps" true : 3; endrewards
"""
WALK_CASE = """\
case: walk
discount: 0.9
program: {file: walk.prism, owner: {capability: [timer]}}
environment:
  parameters: {top: {int: [3, 5]}, slip: {probability: [0, 1]}}
  configurations:
    near: {top: 3, slip: 0.25}
    far: {top: 5, slip: 0.1}
capability:
  parameters: {lazy: bool}
  configurations: {generate: {lazy: {from: all}}}
objective:
  parameters: {limit: int}
  goal: '"goal"'
  ends_in: '"goal" & x <= limit | x = N & late & "done"'
  unsafe: home & late
  reward: cost
  sign: -1
  horizon: limit
  configurations: {short: {limit: 4}, long: {limit: 9}}
online:
  met: {environment: {top: 4, slip: 0.5}, capability: {lazy: false}, objective: {limit: 7}}
"""
LAMPS = """\
mdp
const int prize;
const double stick;
module lamps
  place : [0..3] init 0;
  lit : bool init false;
  [left] !lit -> (place'=max(place-1, 0));
  [right] !lit -> (place'=min(place+1, 3));
  [switch] !lit -> 1-stick : (lit'=(place=prize)) + stick : true;
endmodule
label "goal" = lit;
rewards "steps" !lit : 1; endrewards
"""
LAMPS_CASE = """\
case: lamps
program: {file: lamps.prism}
environment:
  parameters: {prize: {int: [0, 3]}}
  configurations: {generate: {prize: {from: all}}}
capability:
  parameters: {stick: {probability: [0, 1]}}
  configurations: {smooth: {stick: 0.1}, sticky: {stick: 0.5}}
objective: {goal: '"goal"', ends_in: '"goal"', reward: steps, sign: -1, horizon: 30}
online:
  met: {environment: {prize: 2}, capability: {stick: 0.3}}
"""


def written_case(folder: Path, case: str, **files: str) -> WrittenCase:
    """Write a case and the texts that it names, and load it."""
    path = write_case(folder, case, **files)
    study = load_case(path)
    assert isinstance(study, WrittenCase)
    return study


def write_case(folder: Path, case: str, **files: str) -> Path:
    for name, text in files.items():
        (folder / f"{name}.prism").write_text(text, encoding="utf-8")
    (folder / "case.yaml").write_text(case, encoding="utf-8")
    return folder / "case.yaml"
