"""Learning offline again: what is met outside the base is met sooner the second time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load

from merap.knowledge.base import KnowledgeBase, open_knowledge
from merap.learning.config import TrainingConfig
from merap.mapek.records import EpisodeRow
from merap.mapek.replaying import check_decisions
from merap.mapek.run import run_loop
from merap.mapek.scenario import Scenario
from merap.runs.run_folder import RunFolder
from tests.support.loop_runs import scenario, timeless
from tests.support.paths import MODELS
from tests.support.trained_runs import trained

# RQ1-5: 16 goals from (3, 3) to (6, 6), and none of them is (2, 2).
AGAIN = """\
scenario: again
system: {environment: open, capability: full, objective: {goal: [4, 4]}}
episodes: 80
seed: SEED
changes:
  - {at: {episode: 20}, objective: {goal: [2, 2]}}
  - {at: {episode: 45}, objective: {goal: [4, 4]}}
  - {at: {episode: 65}, objective: {goal: [2, 2]}}
strategy: {updates: 5}
learning: {extend: EXTEND, updates: 10}
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    config = TrainingConfig(updates=40)
    return trained(tmp_path_factory.mktemp("runs") / "run", config, MODELS / "paper-grid" / "rq1-5.yaml")


@pytest.fixture
def knowledge(tmp_path: Path) -> Iterator[KnowledgeBase]:
    with open_knowledge(f"sqlite:///{tmp_path / 'knowledge.db'}") as opened:
        yield opened


def again(folder: Path, seed: int = 0, *, extend: bool = True) -> Scenario:
    return scenario(folder, AGAIN.replace("SEED", str(seed)).replace("EXTEND", str(extend).lower()))


@pytest.mark.slow
def test_the_second_encounter_takes_fewer_episodes(run: RunFolder, tmp_path: Path) -> None:
    """For each of these seeds no more, in sum fewer, than the first one and than without learning again.

    The seeds are fixed, so luck has no part.
    """
    first: list[int] = []
    second: list[int] = []
    without: list[int] = []
    for seed in range(4):
        extended = run_loop(run, again(tmp_path, seed)).reactions
        plain = run_loop(run, again(tmp_path, seed, extend=False)).reactions
        for found, reaction in ((first, extended[0]), (second, extended[2]), (without, plain[2])):
            assert reaction.episodes is not None
            found.append(reaction.episodes)
    assert all(later <= earlier for later, earlier in zip(second, first, strict=True))
    assert sum(second) < sum(first)
    assert sum(second) < sum(without)


@pytest.mark.slow
def test_what_was_added_is_in_the_knowledge_base_and_decided_again(
    run: RunFolder, tmp_path: Path, knowledge: KnowledgeBase
) -> None:
    run_loop(run, again(tmp_path), knowledge=knowledge)
    decided = [one for one in knowledge.decisions(1) if one.kind == "extended"]
    assert len(decided) == 1
    assert "of the belief is outside the base" in decided[0].reasons[0]
    name = f"met_{decided[0].episode}"
    (added,) = [model for model in knowledge.models(1) if model.name == name]
    before, after = [policy for policy in knowledge.policies(1) if policy.kind == "meta"]
    assert (after.step, after.model) == (run.config.updates + 10, added.id)
    old, new = load(knowledge.blob(before.digest)), load(knowledge.blob(after.digest))
    assert old.keys() == new.keys()
    assert any(not np.array_equal(old[name], new[name]) for name in old)
    assert check_decisions(run, knowledge, 1) == ()


@pytest.mark.slow
def test_a_killed_run_goes_on_as_if_it_had_not_been(
    run: RunFolder, tmp_path: Path, knowledge: KnowledgeBase
) -> None:
    """Killed after the base was extended; what was learned again is learned once more."""
    found = again(tmp_path)
    undisturbed = timeless(run_loop(run, found))

    def kill(row: EpisodeRow) -> None:
        if row.episode == 50:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_loop(run, found, knowledge=knowledge, on_episode=kill)
    assert timeless(run_loop(run, found, knowledge=knowledge, resume=True)) == undisturbed


@pytest.mark.slow
def test_what_is_covered_is_not_added(run: RunFolder, tmp_path: Path, knowledge: KnowledgeBase) -> None:
    text = AGAIN.replace("[2, 2]", "[5, 5]").replace("SEED", "0").replace("EXTEND", "true")
    run_loop(run, scenario(tmp_path, text), knowledge=knowledge)
    kinds = [one.kind for one in knowledge.decisions(1)]
    assert "settled" in kinds
    assert "extended" not in kinds
