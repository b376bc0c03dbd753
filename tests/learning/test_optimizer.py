"""Adam's compiled step against torch's."""

from __future__ import annotations

import pytest
import torch

from merap.learning.optimizer import step
from tests.support.learning_examples import seeded


def _adam(leaves: list[torch.Tensor]) -> torch.optim.Adam:
    first, second = leaves
    return torch.optim.Adam([{"params": [first], "lr": 0.1}, {"params": [second], "lr": 0.02}])


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_steps_are_those_of_torch(dtype: torch.dtype) -> None:
    """Rates change on the way, as in training; what is kept is the same too."""
    generator = seeded(0)
    mine = [torch.randn(50, generator=generator, dtype=dtype), torch.zeros(3, dtype=dtype)]
    torchs = [leaf.clone() for leaf in mine]
    one, other = _adam(mine), _adam(torchs)
    tolerance = 1e-6 if dtype == torch.float32 else 1e-13
    for number in range(1, 8):
        for leaf, twin in zip(mine, torchs, strict=True):
            leaf.grad = torch.randn(leaf.shape, generator=generator, dtype=dtype) * 10.0 ** (number - 5)
            twin.grad = leaf.grad.clone()
        for optimizer in (one, other):
            optimizer.param_groups[0]["lr"] = 0.1 / number
        step(one)
        other.step()
        for leaf, twin in zip(mine, torchs, strict=True):
            torch.testing.assert_close(leaf, twin, rtol=tolerance, atol=tolerance)
            for name in ("step", "exp_avg", "exp_avg_sq"):
                kept, expected = one.state[leaf][name], other.state[twin][name]
                torch.testing.assert_close(kept, expected, rtol=10 * tolerance, atol=0)


def test_other_optimizers_step_themselves() -> None:
    leaf = torch.ones(2)
    leaf.grad = torch.tensor([1.0, -2.0])
    step(torch.optim.SGD([leaf], lr=0.5))
    assert leaf.tolist() == [0.5, 2.0]
