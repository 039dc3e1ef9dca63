"""Other builds of the same body: every bone's length changed, left and right alike, its turns left as they are."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from stages.shared.kinematics.device import onto
from stages.shared.training.task import rows_of

if TYPE_CHECKING:
    from stages.shared.training.windows import Windows

_KINDS = (0, 1, 1, 2, 2)  # of body groups: the spine, both arms, both legs
_LEGS = 2


def with_other_proportions(windows: Windows, most: float | np.ndarray, rng: np.random.Generator) -> Windows:
    """Windows of bodies whose bones are up to `most` times as long or as short, drawn for each window.

    A bone's frame grows or shrinks as a whole: its tail, and where its children hang on it. The n-th bone of the left
    arm gets the factor of the n-th of the right, and so do legs. The root's path is scaled as the legs are, about the
    world's origin on the floor, so that feet stand where they stood. Rotations stay.

    Args:
        most: largest factor, 1 or more, for all windows or (B,) for each; its inverse is the smallest. Factors are
            drawn evenly in their logarithm.
        rng: each window's factors are drawn from its own generator (`rows_of`).
    """
    batch, bones = windows.groups.shape
    device = windows.heads.device
    kinds = onto(torch.tensor(_KINDS), device)[windows.groups]
    ranks = _ranks(windows)
    table = np.stack([row.uniform(-1, 1, (max(_KINDS) + 1, bones)) for row in rows_of(rng, batch)])
    reach = onto(torch.from_numpy(np.log(np.broadcast_to(most, batch))), device).unsqueeze(1)
    rows = torch.arange(batch, device=device).unsqueeze(1)
    factors = onto(torch.from_numpy(table), device)[rows, kinds, ranks].mul(reach).exp().float()

    lengths = windows.tails.norm(dim=-1) * ((kinds == _LEGS) & (windows.weights > 0))
    legs = (lengths * factors).sum(1) / lengths.sum(1).clamp_min(1e-9)
    legs = torch.where(lengths.sum(1) > 0, legs, torch.ones_like(legs))
    heads = _hung(windows, factors, legs)
    return replace(
        windows, heads=heads, tails=windows.tails * factors.unsqueeze(-1), weights=windows.weights * factors
    )


def _ranks(windows: Windows) -> Tensor:
    """(B, J) how many bones of the same body group come before each."""
    same = windows.groups.unsqueeze(2) == windows.groups.unsqueeze(1)
    return torch.tril(same, diagonal=-1).sum(2)


def _hung(windows: Windows, factors: Tensor, legs: Tensor) -> Tensor:
    """Heads (B, T, J, 3): each at its parent's, the way between them scaled; a scale needs no frame to be in."""
    rows = torch.arange(len(factors), device=factors.device)
    heads = windows.heads.clone()
    heads[:, :, 0] = windows.heads[:, :, 0] * legs.view(-1, 1, 1)
    for bone in range(1, heads.shape[2]):  # parents come before children
        parent = windows.parents[:, bone]
        above = parent.clamp_min(0)
        way = (windows.heads[:, :, bone] - windows.heads[rows, :, above]) * factors[rows, above].view(-1, 1, 1)
        moved = heads[rows, :, above] + way
        heads[:, :, bone] = torch.where((parent >= 0).view(-1, 1, 1), moved, windows.heads[:, :, bone])
    return heads
