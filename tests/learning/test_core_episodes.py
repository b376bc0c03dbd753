"""Discounted sums against closed forms and recursions."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from merap.learning.core import episodes as core
from tests.support.learning_examples import seeded


def discounted_sums(terms: Tensor, discount: float) -> Tensor:
    """Of rows [.., T]."""
    rows = np.atleast_2d(terms.numpy())
    return torch.from_numpy(core.discounted_sums(rows, discount)).view(terms.shape)


def test_sums_of_a_constant_are_geometric() -> None:
    gamma, horizon = 0.95, 18
    expected = [(1 - gamma ** (horizon - t)) / (1 - gamma) for t in range(horizon)]
    found = discounted_sums(torch.ones(2, 3, horizon, dtype=torch.float64), gamma)
    np.testing.assert_allclose(found.numpy(), np.broadcast_to(expected, (2, 3, horizon)), rtol=1e-13)


@pytest.mark.parametrize("discount", [0.0, 0.5, 1.0])
def test_sums_follow_the_backward_recursion(discount: float) -> None:
    terms = torch.randn(4, 2, 6, generator=seeded(0), dtype=torch.float64)
    expected: list[Tensor] = []
    ahead = torch.zeros(4, 2, dtype=torch.float64)
    for term in reversed(terms.unbind(dim=-1)):
        ahead = term + discount * ahead
        expected.insert(0, ahead)
    torch.testing.assert_close(discounted_sums(terms, discount), torch.stack(expected, -1))


def test_sums_by_hand() -> None:
    # 1 + 2/2 + 4/4, 2 + 4/2, 4
    assert discounted_sums(torch.tensor([1.0, 2.0, 4.0]), 0.5).tolist() == [3, 4, 4]
    assert discounted_sums(torch.tensor([1.0, 2.0, 4.0]), 0.0).tolist() == [1, 2, 4]
    assert discounted_sums(torch.tensor([1.0, 2.0, 4.0]), 1.0).tolist() == [7, 6, 4]
