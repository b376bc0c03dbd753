"""Steps of torch's optimizers on leaves of a few thousand numbers.

There `torch.optim.Adam.step` spends twenty times as long on its way to the arithmetic as in it, a tenth of
an exact update. What it keeps, and how that is saved and loaded, stays torch's.
"""

from __future__ import annotations

import torch

from merap.learning.core.adam import descend


def step(optimizer: torch.optim.Optimizer) -> None:
    """A step down the gradients of its leaves; of Adam the plain one, without weight decay."""
    if not isinstance(optimizer, torch.optim.Adam):
        optimizer.step()
        return
    for group in optimizer.param_groups:
        beta1, beta2 = group["betas"]
        for leaf in group["params"]:
            state = optimizer.state[leaf]
            if not state:
                moments = {"exp_avg": torch.zeros_like(leaf), "exp_avg_sq": torch.zeros_like(leaf)}
                state.update(step=torch.zeros(()), **moments)
            state["step"] += 1
            descend(
                leaf.numpy(),
                leaf.grad.numpy(),
                state["exp_avg"].numpy(),
                state["exp_avg_sq"].numpy(),
                int(state["step"]),
                group["lr"],
                beta1,
                beta2,
                group["eps"],
            )
