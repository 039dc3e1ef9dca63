"""Gradient descent at test time, for methods whose networks judge a motion instead of making one."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor


def descended(start: Sequence[Tensor], loss: Callable[..., Tensor], *, steps: int, rate: float) -> tuple[Tensor, ...]:
    """The tensors after steps of Adam that lower their loss.

    The networks' own gradients are neither computed nor touched. Works inside `torch.no_grad()`.

    Args:
        start: where the descent begins; not changed. loss: a scalar, of the tensors in this order.
        steps, rate: of Adam.
    """
    with torch.enable_grad():
        moved = [each.detach().clone().requires_grad_() for each in start]
        optimiser = torch.optim.Adam(moved, lr=rate)
        for _ in range(steps):
            for each, gradient in zip(moved, torch.autograd.grad(loss(*moved), moved), strict=True):
                each.grad = gradient
            optimiser.step()
    return tuple(each.detach() for each in moved)
