"""Outer optimisers: torch's own steps on the rows of numbers that training moves.

The classes `torch.optim.Adam` and `torch.optim.SGD` import torch's compiler when they are made, which takes
as long as a whole training; the function that does Adam's steps does not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor
from torch.optim.adam import adam


class Optimizer:
    """Descends gradients on rows of numbers, which are changed in place.

    Args:
        rows: float [P] each.
        rates: length of a step for each row; may be set anew before any step.
        adaptive: by Adam (Kingma & Ba 2015, algorithm 1), else by plain gradient steps.
    """

    def __init__(self, rows: Sequence[Tensor], rates: Sequence[float], *, adaptive: bool) -> None:
        self.rates = list(rates)
        self._rows = rows
        self._moments = [
            {"step": torch.zeros(()), "exp_avg": torch.zeros_like(row), "exp_avg_sq": torch.zeros_like(row)}
            for row in rows
            if adaptive
        ]

    @torch.no_grad()
    def step(self, gradients: Sequence[Tensor]) -> None:
        """Take a step down the gradient of each row."""
        if not self._moments:
            for row, gradient, rate in zip(self._rows, gradients, self.rates, strict=True):
                row.add_(gradient, alpha=-rate)
        for row, gradient, rate, moments in zip(
            self._rows, gradients, self.rates, self._moments, strict=False
        ):
            adam(
                [row],
                [gradient],
                [moments["exp_avg"]],
                [moments["exp_avg_sq"]],
                [],
                [moments["step"]],
                fused=True,
                amsgrad=False,
                beta1=0.9,
                beta2=0.999,
                lr=rate,
                weight_decay=0.0,
                eps=1e-8,
                maximize=False,
            )

    def state_dict(self) -> dict[str, Tensor]:
        """Return what a later step depends on, by row and name; the tensors are not copied."""
        return {
            f"{index}.{name}": value
            for index, moments in enumerate(self._moments)
            for name, value in moments.items()
        }

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        """Go on from what `state_dict` has returned."""
        for name, value in self.state_dict().items():
            value.copy_(state[name])
