"""Changing a body's proportions: every bone's length is scaled, left and right equally; rotations are unchanged."""

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
    """Windows with bones scaled by random factors between 1 / `most` and `most`, drawn for each window.

    A factor scales a bone's whole frame: its tail and its children's offsets. The n-th bones of the left and right
    arm get the same factor, and so do those of the legs. The root's path is scaled by the legs' factor, about the
    world's origin on the floor, so that the feet stay on the floor without sliding. Rotations do not change.

    Args:
        most: largest factor, 1 or more, for all windows or (B,) for each; its inverse is the smallest. The logarithm
            of a factor is uniform.
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
    """(B, J) number of bones of the same body group before each bone."""
    same = windows.groups.unsqueeze(2) == windows.groups.unsqueeze(1)
    return torch.tril(same, diagonal=-1).sum(2)


def _hung(windows: Windows, factors: Tensor, legs: Tensor) -> Tensor:
    """Heads (B, T, J, 3) with the vector from each bone's parent scaled; uniform scaling is the same in any frame."""
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
