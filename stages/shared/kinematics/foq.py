"""First-frame-offset quaternions (PC-MRL 3.3): rotations without their absolute roll.

A point cloud does not determine the roll of a bone about itself, only how the roll changes. FOQ keeps only the
change: every rotation is relative to that of the first frame, and any constant rotation of a bone's own frame (a roll
about the bone, or another rest pose) cancels: (q_t x r) x (q_0 x r)^-1 = q_t x r x r^-1 x q_0^-1 = q_t x q_0^-1.

FOQ are rotations about the world's axes: turning the whole motion by y gives y x foq x y^-1. Since a product with a
unit quaternion keeps distances, two motions with the same first frame have the same distance in FOQ as in rotations.
"""

from __future__ import annotations

import torch
from torch import Tensor

from stages.shared.kinematics.rotations import conjugate, multiply


def first_frame_offsets(rotations: Tensor) -> Tensor:
    """foq_t = q_t x q_0^-1 (PC-MRL 3.3).

    Args:
        rotations: (..., T, J, 4) global unit quaternions xyzw, sign-continuous in time.

    Returns: (..., T, J, 4) of the same dtype, sign-continuous; the first frame is the identity (0, 0, 0, 1).
    """
    first = conjugate(rotations[..., :1, :, :])
    return multiply(rotations, first.expand_as(rotations))


def rotations_from_offsets(offsets: Tensor, known: Tensor, frame: int = 0) -> Tensor:
    """The inverse, from one frame with known rotations: q_t = foq_t x foq_k^-1 x q_k.

    Args:
        offsets: (..., T, J, 4) FOQ, unit, xyzw.
        known: (..., J, 4) global rotations of frame `frame`.
        frame: the known frame; by default the first, whose FOQ is the identity.

    Returns: (..., T, J, 4) global unit quaternions.
    """
    at_known = conjugate(offsets[..., frame, :, :])
    first = multiply(at_known, known)
    # Normalised again, so that rounding does not accumulate over a long chain of products.
    product = multiply(offsets, first.unsqueeze(-3).expand_as(offsets))
    return torch.nn.functional.normalize(product, dim=-1)
