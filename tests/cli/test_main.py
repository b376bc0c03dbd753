"""The command line end to end: what it writes, what it prints, its exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest
import stormpy
from ruamel.yaml import YAML

from merap.families.loading import load_case
from merap.families.models import explored
from tests.support.command_line import merap, refused
from tests.support.paths import MODELS
from tests.support.slow_chain import slow_case

GRID = MODELS / "paper-grid" / "rq1-3.yaml"
RUNNING = MODELS / "running-example"


def tree(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_render_writes_the_eighteen_models_and_the_same_bytes_twice(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    assert merap("render", RUNNING, "-o", first).returncode == 0
    assert merap("render", RUNNING, "-o", second).returncode == 0
    # the paper's Table I: 3 environments, 2 capabilities, 3 objectives
    expected = {
        f"{environment}.{capability}.{objective}.prism"
        for environment in ("b_blocked", "c_blocked", "bc_blocked")
        for capability in ("speed_low", "speed_high")
        for objective in ("g1", "g2", "g3")
    }
    assert set(tree(first)) == expected | {"manifest.json"}
    assert tree(first) == tree(second)
    assert merap("render", RUNNING, "-o", first).returncode == 0
    assert tree(first) == tree(second)


def test_render_refuses_a_folder_that_holds_something_else(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    assert "thesis.tex" in refused("render", GRID, "-o", tmp_path)
    assert set(tree(tmp_path)) == {"thesis.tex"}


def test_verify_reports_verdicts(tmp_path: Path) -> None:
    report = tmp_path / "verdicts.json"
    done = merap("verify", RUNNING, "--json", report)
    assert done.returncode == 0, done.stderr
    verdicts = json.loads(report.read_text())["verdicts"]
    assert len({verdict["combination"] for verdict in verdicts}) == 18
    for verdict in verdicts:
        keys = {"combination", "name", "property", "engine", "value", "lower", "upper", "holds", "status"}
        assert keys <= verdict.keys()
        assert verdict["engine"] == "storm"
        assert verdict["status"] == "ok"
    texts = {verdict["property"] for verdict in verdicts}
    assert {'Pmax=? [F "goal"]', 'Pmax=? [F<=40 "goal"]', 'R{"objective"}max=? [C<=40discount=0.98]'} <= texts


def test_verify_does_not_write_over_a_report(tmp_path: Path) -> None:
    report = tmp_path / "verdicts.json"
    report.write_text("mine")
    assert str(report) in refused("verify", GRID, "--property", "reach", "--json", report)
    assert report.read_text() == "mine"


def test_a_false_verdict_exits_with_1_and_says_what_cuts_the_goal_off(tmp_path: Path) -> None:
    text = (RUNNING / "case.yaml").read_text()
    case = tmp_path / "case.yaml"
    case.write_text(text.replace("b_blocked: {blocked: [B]}", "b_blocked: {blocked: [A, B, C]}"))
    done = merap("verify", case, "--property", "reach")
    assert done.returncode == 1
    assert "b_blocked.speed_low.g1" in done.stdout
    assert "cut off by blocked A, B, C (environment b_blocked)" in done.stdout


@pytest.mark.slow
def test_a_property_over_its_time_is_one_line_and_exits_with_3(tmp_path: Path) -> None:
    case = tmp_path / "case.yaml"
    endless = """    endless: 'Pmax=? [F<=2000000000 "goal"]'"""
    case.write_text(slow_case(20, endless))
    done = merap("verify", case, "--timeout", "4")
    assert (done.returncode, done.stderr) == (3, "")
    header, row, *lines = done.stdout.splitlines()
    assert header.split() == ["combination", "reach", "reach_within_horizon", "reward", "endless"]
    assert row.split() == ["e.c.o", "0.5", "0", "0", "timeout"]
    assert lines == [
        """timeout: e.c.o: property 'Pmax=? [F<=2000000000 "goal"]': not done within 4 s""",
        "1 combination, 4 verdicts, 0 false, 1 without an answer",
    ]
    # a false verdict is known, whatever is not
    false = """    sure: 'Pmin>0.5 [F "goal"]'"""
    case.write_text(slow_case(20, f"{endless}\n{false}"))
    assert merap("verify", case, "--timeout", "4").returncode == 1
    for limit in ("0", "-1", "nan", "inf"):
        assert "expected seconds above 0" in refused("verify", case, "--timeout", limit)


def test_a_case_without_goal_is_verified(tmp_path: Path) -> None:
    case = tmp_path / "case.yaml"
    text = slow_case(3, "").replace("  properties:\n\n", "").replace("  parameters: {goal: location}\n", "")
    case.write_text(
        text.replace("{goal: s6}", "{}").replace("{to: goal, value: 1}", "{value: -1}").replace("goal", "s6")
    )
    report = tmp_path / "verdicts.json"
    done = merap("verify", case, "--json", report)
    assert done.returncode == 0, done.stdout
    verdicts = json.loads(report.read_text())["verdicts"]
    assert [verdict["name"] for verdict in verdicts] == ["complete", "complete_within_horizon", "reward"]
    assert verdicts[0]["value"] == pytest.approx(0.5, abs=1e-9)


def test_a_base_too_large_to_enumerate_is_refused_with_count_and_limit(tmp_path: Path) -> None:
    out = tmp_path / "out"
    line = refused("render", MODELS / "paper-grid" / "rq1-4.yaml", "-o", out)
    assert "27027" in line
    assert "10000" in line
    assert not out.exists()
    done = merap("render", MODELS / "paper-grid" / "rq1-4.yaml", "-o", out, "--sample", "3")
    assert done.returncode == 0, done.stderr
    assert len(list(out.glob("*.prism"))) == 3


def test_difference_of_a_covered_system_is_0(tmp_path: Path) -> None:
    report = tmp_path / "difference.json"
    done = merap("difference", GRID, "--system", "met", "--json", report)
    assert done.returncode == 0, done.stderr
    found = json.loads(report.read_text())
    assert found["difference"] == 0
    assert found["nearest"].split(".")[1] == "no_entry_r3c4"


def test_difference_weighs_its_terms(tmp_path: Path) -> None:
    report = tmp_path / "difference.json"
    done = merap("difference", RUNNING, "--system", "met", "--w1", "0.5", "--w2", "2", "--json", report)
    assert done.returncode == 0, done.stderr
    for terms in json.loads(report.read_text())["terms"]:
        assert terms["total"] == pytest.approx(0.5 * terms["transition"] + 2 * terms["reward"])


def test_an_unknown_system_is_refused_with_what_there_is() -> None:
    line = refused("difference", GRID, "--system", "mett")
    assert "'mett'" in line
    assert "met" in line


def test_export_writes_archives_that_storm_reads(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert merap("export", GRID, "-o", out).returncode == 0
    case = load_case(GRID)
    assert len(list(out.glob("*.umb"))) == case.size == 3
    for combination in case.combinations():
        model = stormpy.build_model_from_umb(str(out / f"{combination.name}.umb"))
        assert model.nr_states == explored(combination).num_states


def test_show_draws_png_and_svg(tmp_path: Path) -> None:
    assert merap("show", RUNNING, "-o", tmp_path / "map.png").returncode == 0
    assert merap("show", RUNNING, "-o", tmp_path / "map.svg").returncode == 0
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in (tmp_path / "map.svg").read_bytes()


def test_schema_is_a_json_schema_that_takes_the_shipped_cases(tmp_path: Path) -> None:
    schema = json.loads(merap("schema").stdout)
    jsonschema.Draft202012Validator.check_schema(schema)
    for path in (RUNNING / "case.yaml", GRID):
        jsonschema.validate(YAML(typ="safe").load(path), schema)


def test_schema_is_that_of_a_scenario_too() -> None:
    schema = json.loads(merap("schema", "--scenario").stdout)
    jsonschema.validate(YAML(typ="safe").load(RUNNING / "three-changes.yaml"), schema)


def test_doctor_names_what_is_there() -> None:
    done = merap("doctor")
    assert done.returncode == 0
    assert "stormpy" in done.stdout


def test_a_missing_file_is_one_line() -> None:
    assert "nowhere.yaml" in refused("validate", "nowhere.yaml")


def test_wrong_usage_exits_with_2() -> None:
    assert merap("verify").returncode == 2
    assert merap("no-such-verb").returncode == 2
