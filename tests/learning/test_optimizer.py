"""Outer steps against those of torch's own classes."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from merap.learning.optimizer import Optimizer
from tests.support.learning_examples import seeded


def _torchs(rows: list[Tensor], adaptive: bool) -> torch.optim.Optimizer:
    groups = [{"params": [row], "lr": 0.1} for row in rows]
    return torch.optim.Adam(groups, fused=True) if adaptive else torch.optim.SGD(groups)


@pytest.mark.parametrize("adaptive", [False, True])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_steps_are_those_of_torchs_classes(dtype: torch.dtype, adaptive: bool) -> None:
    """Rates change on the way, as in training; after some steps another optimiser goes on."""
    generator = seeded(0)
    mine = [torch.randn(50, generator=generator, dtype=dtype), torch.zeros(3, dtype=dtype)]
    theirs = [row.clone() for row in mine]
    found, other = Optimizer(mine, (0.1, 0.1), adaptive=adaptive), _torchs(theirs, adaptive)
    for number in range(1, 8):
        gradients = [torch.randn(row.shape, generator=generator, dtype=dtype) for row in mine]
        for row, gradient in zip(theirs, gradients, strict=True):
            row.grad = gradient * 10.0 ** (number - 5)
        other.param_groups[0]["lr"] = 0.1 / number
        if number == 4:
            state = {name: value.clone() for name, value in found.state_dict().items()}
            found = Optimizer(mine, (0.1, 0.1), adaptive=adaptive)
            found.load_state_dict(state)
        found.rates = [0.1 / number, 0.1]
        found.step([gradient * 10.0 ** (number - 5) for gradient in gradients])
        other.step()
        for row, twin in zip(mine, theirs, strict=True):
            assert torch.equal(row, twin)


def test_plain_steps_keep_no_state() -> None:
    row = torch.ones(2)
    optimizer = Optimizer([row], [0.5], adaptive=False)
    optimizer.step([torch.tensor([1.0, -2.0])])
    assert row.tolist() == [0.5, 2.0]
    assert optimizer.state_dict() == {}
