"""First-frame-offset quaternions (PC-MRL 3.3): rotations without their absolute roll.

A point cloud cannot tell how far a bone is rolled about itself, only how the roll changes. FOQ keeps just that: every
rotation is taken relative to the one of the first frame, and whatever constant rotation a bone's own frame carries
(a roll about the bone, or another rest pose altogether) falls out:
(q_t x r) x (q_0 x r)^-1 = q_t x r x r^-1 x q_0^-1 = q_t x q_0^-1.

FOQ are rotations about the world's axes: turning the whole motion by y gives y x foq x y^-1. Since a product with a
unit quaternion keeps distances, two motions that share their first frame are as far apart in FOQ as in rotations.
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
    """The inverse, from the one frame whose rotations are known: q_t = foq_t x foq_k^-1 x q_k.

    Args:
        offsets: (..., T, J, 4) FOQ, unit, xyzw.
        known: (..., J, 4) global rotations of frame `frame`.
        frame: which frame is known; the first by default, of which the FOQ is the identity.

    Returns: (..., T, J, 4) global unit quaternions.
    """
    at_known = conjugate(offsets[..., frame, :, :])
    first = multiply(at_known, known)
    # Rounding must not add up over a long chain of products: unit length is asked for again.
    product = multiply(offsets, first.unsqueeze(-3).expand_as(offsets))
    return torch.nn.functional.normalize(product, dim=-1)
