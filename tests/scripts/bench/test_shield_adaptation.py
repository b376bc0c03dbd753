from __future__ import annotations

from pathlib import Path

from scripts.bench.shield_adaptation import ADAPTING, RANDOM, adaptation_figures
from tests.support.paths import MODELS
from tests.support.shield_examples import gutter


def test_the_same_seeds_violate_without_a_shield_and_wait_with_one(tmp_path: Path) -> None:
    """At random an episode of ten steps slides with a probability of 0.4, and none of 40 does so in 1e-9."""
    case = gutter(tmp_path)
    alone, kept = (adaptation_figures(case, "met", RANDOM, threshold, 40) for threshold in (None, 0.0))
    assert alone["violations"] > 0
    assert alone["fallback_steps"] is None
    assert (kept["episodes"], kept["violations"], kept["completed"]) == (40, 0, 0)
    assert (kept["mean_return"], kept["fallback_steps"]) == (-10.0, 0)


def test_the_settings_of_the_bench_are_there() -> None:
    for setting in ADAPTING:
        assert (MODELS / setting.case / "case.yaml").is_file()
