"""A recorded run again, in order, and compared with what is derived anew."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from merap.knowledge.base import open_knowledge
from merap.knowledge.replay import DecisionDifference, decision_differences, timeline
from merap.knowledge.rows import DecisionRow
from tests.support.recorded_runs import GOAL, LATE, REPLAN, RESET, SETTLED, STEP, UNSEEN, record_run


def test_decisions_come_after_what_was_seen_at_their_step(knowledge_url: str) -> None:
    with open_knowledge(knowledge_url) as knowledge:
        run = record_run(knowledge)
        assert [*timeline(knowledge, run)] == [RESET, STEP, REPLAN, UNSEEN, GOAL, SETTLED, LATE]


def test_differences_say_what_was_recorded_and_what_was_derived() -> None:
    otherwise = DecisionRow(0, 1, "replan", ("reward fell below 0.4",))
    update = DecisionRow(2, 0, "update", ("one",))
    found = decision_differences(
        [REPLAN, SETTLED, update], [otherwise, update], {"replan", "settled", "update"}
    )
    assert found == (
        DecisionDifference(0, 1, "replan", REPLAN.reasons, otherwise.reasons),
        DecisionDifference(1, 1, "settled", (), None),
    )
    assert str(found[0]) == (
        "episode 0, step 1: replan: recorded 'reward fell below 0.5; a goal was moved', "
        "derived 'reward fell below 0.4'"
    )
    assert str(found[1]) == "episode 1, step 1: settled: recorded '', derived nothing"
    assert decision_differences([REPLAN, SETTLED], [], {"update"}) == ()


decisions = st.lists(
    st.builds(
        DecisionRow,
        episode=st.integers(0, 2),
        step=st.integers(0, 2),
        kind=st.sampled_from(["replan", "update", "clock"]),
        reasons=st.tuples(st.sampled_from("ab")),
        data=st.just({}),
    ),
    max_size=8,
)


@given(decisions)
def test_order_matters_within_a_kind_and_step_alone(rows: list[DecisionRow]) -> None:
    kinds = {"replan", "update"}
    assert decision_differences(rows, rows, kinds) == ()
    by_step = sorted(rows, key=lambda row: (row.kind, -row.episode, -row.step))
    assert decision_differences(rows, by_step, kinds) == ()


@given(decisions, decisions)
def test_every_decision_too_many_or_missing_is_found(
    rows: list[DecisionRow], others: list[DecisionRow]
) -> None:
    kinds = {"replan", "update"}
    found = decision_differences(rows, others, kinds)
    turned = decision_differences(others, rows, kinds)
    assert [(d.episode, d.step, d.kind, d.derived, d.recorded) for d in turned] == [
        (d.episode, d.step, d.kind, d.recorded, d.derived) for d in found
    ]
    surplus = sum(d.derived is None for d in found) - sum(d.recorded is None for d in found)
    assert surplus == sum(row.kind in kinds for row in rows) - sum(row.kind in kinds for row in others)
