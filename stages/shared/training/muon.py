"""Muon (Jordan et al. 2024): steps along a matrix's momentum with all its singular values made about equal.

`torch.optim.Muon` multiplies in bfloat16 on every device. A CPU without bfloat16 instructions only emulates these
products: the step of a small synthesiser then takes several times as long as its forward and backward passes. So
the products here are in the precision that the device computes fastest; in bfloat16, steps are those of PyTorch.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor, nn

from stages.shared.networks.layers.device import computes_bfloat16

_A, _B, _C = 3.4445, -4.7750, 2.0315  # of x -> a x + b x^3 + c x^5, whose five-fold iteration brings (0, 1] near 1
_ROUNDS = 5
_SMALLEST = 1e-7  # norm of a matrix, below which it is not scaled up
_WIDE = 1.5  # from this ratio of the sides on, the iteration on the Gram matrix takes fewer operations


def equal_singular_values(matrix: Tensor, dtype: torch.dtype) -> Tensor:
    """U S V^T with all of S near 1 (about 0.7 to 1.2), of matrix (N, M) = U D V^T: five Newton-Schulz iterations.

    Args:
        matrix: (N, M). dtype: of the products.

    Returns: (N, M) in `dtype`.
    """
    upright = matrix.shape[0] > matrix.shape[1]
    x = matrix.to(dtype)
    x = x.T if upright else x
    x = x / x.norm().clamp(min=_SMALLEST)
    # bfloat16 is too coarse for squared singular values to be all that is known of the matrix.
    if dtype != torch.bfloat16 and x.shape[1] >= _WIDE * x.shape[0]:
        x = _iterated_gram(x @ x.T) @ x
    else:
        for _ in range(_ROUNDS):
            gram = x @ x.T
            x = torch.addmm(x, torch.addmm(gram, gram, gram, beta=_B, alpha=_C), x, beta=_A)
    return x.T if upright else x


def _iterated_gram(gram: Tensor) -> Tensor:
    """The product Q of all rounds' factors, so that Q X is the result of the rounds on X, from X X^T (N, N).

    A round is X <- P X with P = a + b G + c G^2 and G = X X^T; so G <- P G P. All matrices are functions of the first
    G and commute.
    """
    whole = None
    for turn in range(_ROUNDS):
        factor = torch.addmm(gram, gram, gram, beta=_B, alpha=_C)
        factor.diagonal().add_(_A)
        whole = factor if whole is None else factor @ whole
        if turn + 1 < _ROUNDS:
            gram = factor @ (gram @ factor)
    assert whole is not None
    return whole


class Muon(torch.optim.Optimizer):
    """Muon with Nesterov's momentum and decoupled weight decay; its rate is scaled as in Moonlight (Liu et al. 2025,
    eq. 4), so that steps are as long as AdamW's at the same rate.

    Args:
        matrices: parameters of two dimensions. lr: the learning rate.
    """

    def __init__(self, matrices: Iterable[nn.Parameter], lr: float, weight_decay: float, momentum: float = 0.95):
        super().__init__(matrices, {"lr": lr, "weight_decay": weight_decay, "momentum": momentum})

    @torch.no_grad()
    def step(self, closure: Any = None) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Update all matrices that have a gradient."""
        for group in self.param_groups:
            rate, momentum = group["lr"], group["momentum"]
            for matrix in group["params"]:
                if matrix.grad is None:
                    continue
                state = self.state[matrix]
                if "momentum_buffer" not in state:
                    state["momentum_buffer"] = torch.zeros_like(matrix)
                average = state["momentum_buffer"].lerp_(matrix.grad, 1 - momentum)
                dtype = torch.bfloat16 if computes_bfloat16(matrix.device) else torch.float32
                step = equal_singular_values(matrix.grad.lerp(average, momentum), dtype)
                matrix.mul_(1 - rate * group["weight_decay"])
                matrix.add_(step, alpha=-rate * 0.2 * max(matrix.shape) ** 0.5)
