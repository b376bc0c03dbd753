"""The programs whose growth is measured: tasks on one index, and memory linear in their branches."""

from __future__ import annotations

from fractions import Fraction

import pytest

from scripts.bench.growth import batch_of, members, num_bytes


@pytest.mark.parametrize("side", [3, 5])
def test_a_further_branch_takes_sixteen_bytes(side: int) -> None:
    """Successor, probability, reward and continuation, four bytes each; nothing is padded."""
    dry, slippery = (batch_of(members(side, 4, slip)) for slip in (Fraction(0), Fraction(1, 5)))
    further = len(slippery.branch_prob) - len(dry.branch_prob)
    assert further > 0
    assert num_bytes(slippery) - num_bytes(dry) == 16 * further


def test_members_differ_and_share_their_states() -> None:
    first, second = members(3, 2, Fraction(1, 5))
    assert first.num_states == second.num_states == 9 * 6
    assert first.branch_prob.tolist() != second.branch_prob.tolist()
    batch = batch_of([first, second])
    assert batch.enabled.shape == (2, 54, 5)
    assert batch.initial.sum(dim=1).tolist() == pytest.approx([1, 1])
