"""The direction that a cloud faces, from positions and body groups alone."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from stages.shared.kinematics.conventions import GROUPS

_PAIRS = ((1, 2), (3, 4))  # left and right arm, left and right leg
_SPAN = 9  # frames over which a heading is averaged, about 0.3 s


def across_of(points: Tensor, groups: Tensor) -> Tensor:
    """From the right limbs to the left ones, on the ground: (..., T, 2) metres along x and z.

    Args:
        points: (B, T, P, 3). groups: (B, P). A pair of limbs with a missing one is ignored.
    """
    one_hot = F.one_hot(groups.long(), GROUPS).to(points.dtype)
    count = one_hot.sum(1)  # (B, G)
    share = (one_hot / count.unsqueeze(1).clamp_min(1)).transpose(1, 2).unsqueeze(1)
    means = (share @ points)[..., (0, 2)]  # (B, T, G, 2)
    across = torch.zeros_like(means[:, :, 0])
    for left, right in _PAIRS:
        both = ((count[:, left] > 0) & (count[:, right] > 0)).to(points.dtype)
        across = across + both[:, None, None] * (means[:, :, left] - means[:, :, right])
    return across


def headings_of(points: Tensor, groups: Tensor, valid: Tensor | None = None) -> Tensor:
    """Yaw that turns each frame's body to face +Z, its left along +X: (B, T) radians about Y.

    Smoothed over a third of a second. If the sides cannot be found (a body lying on its side), the angle is
    arbitrary.
    """
    across = across_of(points, groups)
    if valid is not None:
        across = across * valid.unsqueeze(-1).to(across.dtype)
    across = F.avg_pool1d(across.transpose(1, 2), _SPAN, stride=1, padding=_SPAN // 2)
    return torch.atan2(across[:, 1], across[:, 0])


def turned(vectors: Tensor, yaw: Tensor) -> Tensor:
    """Vectors (..., 3) turned about Y by angles that broadcast with (...)."""
    x, y, z = vectors.unbind(-1)
    cosine, sine = yaw.cos(), yaw.sin()
    return torch.stack([cosine * x + sine * z, y + torch.zeros_like(cosine), cosine * z - sine * x], dim=-1)


def yaw_quaternions(yaw: Tensor) -> Tensor:
    """(..., 4) xyzw of turns about Y by angles (...)."""
    none = torch.zeros_like(yaw)
    return torch.stack([none, (yaw / 2).sin(), none, (yaw / 2).cos()], dim=-1)
