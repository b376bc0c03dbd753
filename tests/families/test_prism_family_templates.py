"""A template for each concern: one program, or one for each configuration where templates branch."""

from __future__ import annotations

from pathlib import Path

import pytest

from merap.errors import InputError
from merap.families.loading import load_case
from merap.families.models import built, explored
from merap.families.prism_family import WrittenCase
from merap.mdp.comparison import compare

SKY = """\
const double sun;
module sky
  shining : bool init false;
{% for action in ["measure", "sleep"] %}
  [{{ action }}] true -> sun : (shining'=true) + 1-sun : (shining'=false);
{% endfor %}
endmodule
"""
NODE = """\
module node
  charge : [0..{{ size }}] init {{ size // 2 }};
  [measure] charge>0 -> (charge'=charge-1);
  [sleep] true -> (charge'=shining ? min(charge+1, {{ size }}) : charge);
endmodule
label "empty" = charge=0;
"""
CASE = """\
case: sensor
program:
  templates: {environment: sky.j2, capability: node.j2}
  constants: {size: 4}
environment:
  parameters: {sun: {probability: [0, 1]}}
  configurations: {dark: {sun: 0.1}, fair: {sun: 0.5}, bright: {sun: 0.9}}
capability:
  parameters: {thrift: bool}
  configurations: {generate: {thrift: {from: all}}}
objective:
  parameters: {worth: {real: [-1, 2]}}
  unsafe: '"empty"'
  rewards: [{action: measure, value: worth}]
  horizon: 6
  configurations: {wanted: {worth: 1}}
online:
  met: {environment: {sun: 0.25}, capability: {thrift: true}}
"""
THRIFTY = NODE.replace("charge>0", "charge>{{ 1 if thrift else 0 }}")
OPEN = NODE.replace("charge>0", "charge>(thrift?1:0)").replace(
    "module node", "const bool thrift;\nmodule node"
)


def sensor(folder: Path, node: str, sky: str = SKY, case: str = CASE) -> WrittenCase:
    for name, text in (("sky.j2", sky), ("node.j2", node), ("case.yaml", case)):
        (folder / name).write_text(text, encoding="utf-8")
    study = load_case(folder)
    assert isinstance(study, WrittenCase)
    return study


def test_parameters_stay_open_constants_and_modules_are_their_concerns(tmp_path: Path) -> None:
    case = sensor(tmp_path, OPEN)
    assert (case.actions, case.shape, case.warnings) == (("measure", "sleep"), (3, 2, 1), ())
    owners = {one.name: one.concern for one in case.combination_at(0).program.processes}
    assert owners == {"sky": "environment", "node": "capability", "objective": "objective"}
    for one in (*case.combinations(), case.systems["met"]):
        compare(built(one), explored(one)).require_same()


def test_a_template_that_branches_gives_the_same_members_and_says_so(tmp_path: Path) -> None:
    (tmp_path / "open").mkdir()
    (tmp_path / "branching").mkdir()
    whole, apart = sensor(tmp_path / "open", OPEN), sensor(tmp_path / "branching", THRIFTY)
    (warning,) = apart.warnings
    assert warning.startswith(
        "program.templates: they ask for the values of parameters of capability, so each"
    )
    for one, other in zip(whole.combinations(), apart.combinations(), strict=True):
        compare(explored(one), explored(other)).require_same()
    compare(explored(whole.systems["met"]), explored(apart.systems["met"])).require_same()


def test_one_file_holds_all_templates(tmp_path: Path) -> None:
    case = sensor(tmp_path, THRIFTY)
    (tmp_path / "alone").mkdir()
    (tmp_path / "alone" / "case.yaml").write_bytes(case.standalone)
    again = load_case(tmp_path / "alone")
    compare(explored(case.systems["met"]), explored(again.systems["met"])).require_same()
    assert again.standalone == case.standalone


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("{{ size }}]", "{{ siz }}]", "node.j2:2: the template can't be filled in: 'siz' is undefined"),
        ("{% for", "{% fro", "sky.j2:4: the template has a syntax error: Encountered unknown tag 'fro'"),
        ("charge>{{ 1", "charge>>{{ 1", "(line 3 of the text that the template gives)"),
        ("const double sun;", "", "sky.j2: "),
        ("size: 4", "size: 4, unused: 1", "program.constants.unused: the text has no constant 'unused'"),
        ("{thrift: bool}", "{thrift: bool, greed: bool}", "the parameter 'greed' has no value"),
        (
            "init {{ size // 2 }};",
            "init 0; {% if thrift %} more : bool; {% endif %}",
            "case.yaml: program.templates: the templates declare other variables under some configurations",
        ),
        (
            "thrift: {from: all}",
            "thrift: {from: all}, more: {from: all}",
            "that is one text for each of 2002 configurations, at most 256 are allowed",
        ),
    ],
)
def test_what_is_wrong_is_one_line_of_its_template(tmp_path: Path, old: str, new: str, message: str) -> None:
    sources = [SKY, THRIFTY, CASE]
    if "more: {from" in new:
        sources[2] = sources[2].replace("{thrift: bool}", "{thrift: bool, more: {int: [0, 1000]}}")
        sources[1] = f'{sources[1]}label "many" = charge > {{{{ more }}}};\n'
    changed = [source.replace(old, new) for source in sources]
    assert changed != sources
    with pytest.raises(InputError) as caught:
        sensor(tmp_path, changed[1], changed[0], changed[2])
    line = str(caught.value)
    assert message in line.replace(f"{tmp_path}/", "")
    assert len(line.splitlines()) == 1
