"""The knowledge base does the same in SQLite and in PostgreSQL."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest

from merap.errors import InputError, StorageError
from merap.knowledge.base import KnowledgeBase, open_knowledge
from merap.knowledge.reading import PAGE
from merap.knowledge.rows import DecisionRow, EventRow, ObservationRow
from merap.systems.interface import Observation

SETTINGS = {"strategy": "belief", "seeds": [0, 1], "threshold": 0.25, "note": None}
RESET = ObservationRow(0, 0, (8, 0, 0), None, 0.0, 1.0, False, {"lidar": {"1,2": True}}, (True, False))
STEP = ObservationRow(0, 1, (7, 0, 0), 1, -0.5, 1.0, False)
UNSEEN = ObservationRow(0, 2, None, 0, 0.1 + 0.2, 0.0, True)
REPLAN = DecisionRow(0, 2, "replan", ("reward fell below 0.5", "ä \N{SNOWMAN}"), {"statistic": 0.1})
EVENT = EventRow(datetime(2026, 11, 24, 18, 0, 0, 123456, UTC), "monitor", "warning", "late", {"ms": 12})


@pytest.fixture
def knowledge(knowledge_url: str) -> Iterator[KnowledgeBase]:
    with open_knowledge(knowledge_url) as opened:
        yield opened


def begun(knowledge: KnowledgeBase) -> int:
    return knowledge.start_run("first", "running_example", "d" * 64, SETTINGS)


def test_what_was_recorded_is_read_back_after_opening_again(knowledge_url: str) -> None:
    with open_knowledge(knowledge_url) as knowledge:
        run = begun(knowledge)
        model = knowledge.record_model(run, "b_blocked.speed_low.g1", b"umb")
        knowledge.record_policy(run, "meta", 0, b"tensors", model)
        knowledge.record_policy(run, "adapted", 3, b"other tensors")
        knowledge.record_observations(run, [RESET, STEP, UNSEEN])
        knowledge.record_decision(run, REPLAN)
        knowledge.record_event(run, EVENT)
        knowledge.record_checkpoint(run, 1, b"\x00state\xff")
        knowledge.record_checkpoint(run, 2, b"later state")
        knowledge.finish_run(run, {"utility": 3.5})
    with open_knowledge(knowledge_url, create=False) as knowledge:
        (found,) = knowledge.runs()
        assert found == knowledge.run(run)
        assert (found.name, found.case, found.digest) == ("first", "running_example", "d" * 64)
        assert (found.settings, found.report) == (SETTINGS, {"utility": 3.5})
        assert [*knowledge.observations(run)] == [RESET, STEP, UNSEEN]
        assert [*knowledge.decisions(run)] == [REPLAN]
        assert [*knowledge.events(run)] == [EVENT]
        assert [(row.name, knowledge.blob(row.digest)) for row in knowledge.models(run)] == [
            ("b_blocked.speed_low.g1", b"umb")
        ]
        assert [
            (row.kind, row.step, row.model, knowledge.blob(row.digest)) for row in knowledge.policies(run)
        ] == [("meta", 0, model, b"tensors"), ("adapted", 3, None, b"other tensors")]
        checkpoint = knowledge.latest_checkpoint(run)
        assert checkpoint is not None
        assert (checkpoint.episode, checkpoint.state) == (2, b"later state")
        assert knowledge.counts(run) == {
            "model": 1,
            "policy": 2,
            "observation": 3,
            "decision": 1,
            "event": 1,
            "checkpoint": 2,
            "report": 1,
        }


def test_a_run_that_goes_on_has_no_report(knowledge: KnowledgeBase) -> None:
    before = datetime.now(UTC)
    run = knowledge.run(begun(knowledge))
    assert (run.finished, run.report) == (None, None)
    assert before <= run.started <= datetime.now(UTC)
    assert knowledge.latest_checkpoint(run.id) is None


def test_a_correction_is_a_new_row_and_the_last_report_holds(knowledge: KnowledgeBase) -> None:
    run = begun(knowledge)
    knowledge.finish_run(run, {"utility": 1})
    first = knowledge.run(run).finished
    knowledge.finish_run(run, {"utility": 2})
    found = knowledge.run(run)
    assert found.report == {"utility": 2}
    assert found.finished is not None
    assert first is not None
    assert found.finished >= first
    assert knowledge.counts(run)["report"] == 2


def test_history_is_in_the_order_of_recording_over_all_kinds_and_pages(knowledge: KnowledgeBase) -> None:
    run, other = begun(knowledge), begun(knowledge)
    steps = [ObservationRow(0, step, (step,), 0, 0.0, 1.0, False) for step in range(PAGE + 1)]
    knowledge.record_decision(run, REPLAN)
    knowledge.record_observations(run, steps)
    knowledge.record_observations(other, [STEP])
    knowledge.record_decision(run, REPLAN)
    knowledge.record_observations(run, [])
    knowledge.record_observations(run, [STEP, RESET])
    entries = [*knowledge.history(run)]
    assert [entry.position for entry in entries] == [*range(1, PAGE + 6)]
    assert [entry.row for entry in entries] == [REPLAN, *steps, REPLAN, STEP, RESET]
    times = [entry.recorded for entry in entries]
    assert times == sorted(times)
    assert [entry.row for entry in knowledge.history(run, ("decision",))] == [REPLAN, REPLAN]


def test_runs_do_not_mix(knowledge: KnowledgeBase) -> None:
    first, second = begun(knowledge), begun(knowledge)
    knowledge.record_observations(first, [RESET])
    knowledge.record_observations(second, [STEP])
    knowledge.record_checkpoint(first, 1, b"first")
    assert [*knowledge.observations(first)] == [RESET]
    assert [*knowledge.observations(second)] == [STEP]
    assert knowledge.latest_checkpoint(second) is None


def test_equal_bytes_are_stored_once(knowledge: KnowledgeBase) -> None:
    run = begun(knowledge)
    content = bytes(range(256)) * 100
    knowledge.record_model(run, "one", content)
    knowledge.record_model(run, "two", content)
    knowledge.record_policy(run, "meta", 0, content)
    digests = {row.digest for row in knowledge.models(run)}
    digests |= {row.digest for row in knowledge.policies(run)}
    assert digests == {hashlib.sha256(content).hexdigest()}
    assert knowledge.blob(digests.pop()) == content


def test_a_transaction_is_kept_whole(knowledge: KnowledgeBase) -> None:
    run = begun(knowledge)
    with knowledge.transaction():
        knowledge.record_observations(run, [RESET])
        with knowledge.transaction():
            knowledge.record_decision(run, REPLAN)
        assert [*knowledge.observations(run)] == [RESET]
    assert [entry.row for entry in knowledge.history(run)] == [RESET, REPLAN]


def test_a_transaction_that_fails_leaves_nothing(knowledge: KnowledgeBase) -> None:
    run = begun(knowledge)

    def fail() -> None:
        with knowledge.transaction():
            knowledge.record_observations(run, [RESET])
            raise KeyError("of the caller")

    with pytest.raises(KeyError):
        fail()
    assert [*knowledge.history(run)] == []
    knowledge.record_decision(run, REPLAN)
    assert [*knowledge.decisions(run)] == [REPLAN]


def test_a_transaction_is_not_committed_without_a_write_that_failed_in_it(knowledge: KnowledgeBase) -> None:
    run = begun(knowledge)

    def hide_a_failure() -> None:
        with knowledge.transaction():
            knowledge.record_observations(run, [RESET])
            with pytest.raises(InputError, match="JSON"):
                knowledge.record_decision(run, DecisionRow(0, 0, "replan", data={"x": float("nan")}))
            with pytest.raises(StorageError, match="nothing of it is kept"):
                knowledge.record_decision(run, REPLAN)

    with pytest.raises(StorageError, match="nothing of it is kept"):
        hide_a_failure()
    assert [*knowledge.history(run)] == []


def test_numbers_of_numpy_are_recorded_as_numbers(knowledge: KnowledgeBase) -> None:
    run = begun(knowledge)
    data = {"weight": np.float64(0.5), "count": np.int64(3), "flag": np.True_, "list": np.arange(3)}
    knowledge.record_decision(run, DecisionRow(0, 0, "weigh", data=data))
    (found,) = knowledge.decisions(run)
    assert found.data == {"weight": 0.5, "count": 3, "flag": True, "list": [0, 1, 2]}


def test_times_are_kept_in_utc(knowledge: KnowledgeBase) -> None:
    run = begun(knowledge)
    here = EVENT.time.astimezone(timezone(timedelta(hours=5)))
    knowledge.record_event(run, EventRow(here, "monitor", "info", "now"))
    (found,) = knowledge.events(run)
    assert found.time == here
    assert found.time.tzinfo is UTC


def test_text_of_any_kind_is_recorded(knowledge: KnowledgeBase) -> None:
    run = begun(knowledge)
    rubbish = "answered \0 and \ud800 and \N{SNOWMAN}"
    knowledge.record_event(run, EventRow(EVENT.time, "executor", "error", rubbish, {"body": rubbish}))
    (found,) = knowledge.events(run)
    assert found.message == "answered \N{REPLACEMENT CHARACTER} and ? and \N{SNOWMAN}"
    assert found.data == {"body": rubbish}


@pytest.mark.parametrize("value", [float("nan"), float("inf"), object(), {1: {2}}])
def test_what_has_no_json_form_is_refused(knowledge: KnowledgeBase, value: object) -> None:
    run = begun(knowledge)
    with pytest.raises(InputError, match="can't be recorded") as refused:
        knowledge.record_decision(run, DecisionRow(0, 0, "replan", data={"x": value}))
    assert knowledge.place in str(refused.value)
    assert [*knowledge.history(run)] == []


def test_a_reward_must_be_finite() -> None:
    with pytest.raises(InputError, match="observation of episode 2, step 3: the reward is nan"):
        ObservationRow(2, 3, (0,), 0, float("nan"), 1.0, False)


def test_a_run_that_there_is_not_is_named(knowledge: KnowledgeBase) -> None:
    run = begun(knowledge) + 1
    for attempt in (
        lambda: knowledge.run(run),
        lambda: [*knowledge.observations(run)],
        lambda: knowledge.policies(run),
        lambda: knowledge.counts(run),
        lambda: knowledge.latest_checkpoint(run),
        lambda: knowledge.record_decision(run, REPLAN),
        lambda: knowledge.record_observations(run, [STEP]),
        lambda: knowledge.record_model(run, "model", b"umb"),
        lambda: knowledge.finish_run(run, {}),
    ):
        with pytest.raises(InputError, match=f"there is no run {run}"):
            attempt()


def test_an_observation_of_a_system_becomes_a_row() -> None:
    observation = Observation(
        np.array([3, 1]), np.array([True, False]), np.float64(-0.5), 1.0, False, {"lidar": True}
    )
    row = ObservationRow.of(4, 2, 1, observation)
    assert row == ObservationRow(4, 2, (3, 1), 1, -0.5, 1.0, False, {"lidar": True}, (True, False))
