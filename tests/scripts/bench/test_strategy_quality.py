from __future__ import annotations

from pathlib import Path

import pytest

from scripts.bench.following import Lengths, NoiseCondition
from scripts.bench.strategy_quality import COMPARED, strategy_figures
from tests.support.trained_runs import trained


def test_a_row_for_each_strategy_and_three_for_pretrained_policies(tmp_path: Path) -> None:
    run = trained(tmp_path / "run")
    strategies = ("oracle", "gradient", "pretrained:all")
    rows = list(
        strategy_figures(run, strategies, NoiseCondition("slip", slip=0.2), range(2), Lengths(4, 4), 2)
    )
    assert [row["strategy"] for row in rows] == [
        *("oracle", "gradient"),
        *("pretrained, best", "pretrained, median", "pretrained, worst"),
    ]
    assert {row["played"].removeprefix("pretrained:") for row in rows[2:]} == set(run.names)
    for row in rows:
        # what RQ1-3 meets is one of its three models
        assert (row["case"], row["condition"], row["outside"], row["runs"]) == ("paper_rq1_3", "slip", "", 2)
        assert row["mean_initial_return"] <= row["optimum"] + 1e-9
    oracle, _, best, median, worst = rows
    assert oracle["never_episodes_to_within_5_percent"] == 0
    assert oracle["mean_cumulative_regret"] == pytest.approx(0, abs=1e-9)
    finals = [row["mean_final_return"] for row in (best, median, worst)]
    assert finals == sorted(finals, reverse=True)


def test_every_strategy_is_compared() -> None:
    assert "pretrained:all" in COMPARED
    assert {"gradient", "belief", "ope", "joint", "retrieval", "oracle"} < set(COMPARED)
