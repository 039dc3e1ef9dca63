"""Rest-pose augmentation (PC-MRL 3.4, Algorithm 1): the same motion on bones with other tails.

A skeleton that was adapted to a point cloud bends where the cloud fits best, which is not always at the joints that
its author intended, above all at hips and shoulders. So an interpolator is trained on motions whose rest pose was
changed at random; each bone is turned by the smallest rotation towards its old tail. A change that keeps all lengths
changes neither joint positions nor FOQ. The augmentation comes from heads that move and bones that are aimed again
from there.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from stages.shared.kinematics.rotations import conjugate, multiply, rotate, smallest_turn

_AT_TAIL_M = 1e-3  # a child's head this near to its parent's tail is attached to it


def carried_offsets(offsets: Tensor, tails: Tensor, new_tails: Tensor, parents: np.ndarray) -> Tensor:
    """Children's heads after their parents' tails moved in the rest pose.

    A head at its parent's tail moves with it; any other head is rotated like the tail's direction.

    Args:
        offsets: (..., J, 3) heads in their parents' frames. tails, new_tails: (..., J, 3). parents: (J,), -1 first.

    Returns: (..., J, 3) metres; joint 0 keeps its own.
    """
    parent = torch.as_tensor(np.asarray(parents)[1:], dtype=torch.long, device=offsets.device)
    heads, old, new = offsets[..., 1:, :], tails[..., parent, :], new_tails[..., parent, :]
    at_tail = ((heads - old).norm(dim=-1, keepdim=True) < _AT_TAIL_M).expand_as(heads)
    turned = rotate(smallest_turn(old, new), heads)
    return torch.cat([offsets[..., :1, :], torch.where(at_tail, new, turned)], dim=-2)


def moved_rest_pose(
    offsets: Tensor, tails: Tensor, parents: np.ndarray, tail_moves: Tensor, head_moves: Tensor
) -> tuple[Tensor, Tensor]:
    """A rest pose near the given one: every tail is moved, and every head that is not attached to a tail.

    Args:
        offsets, tails: (..., J, 3) metres. parents: (J,).
        tail_moves, head_moves: (..., J, 3) metres, such as normal draws.

    Returns: offsets (..., J, 3) and tails (..., J, 3). Bones of length zero keep it.
    """
    parent = torch.as_tensor(np.asarray(parents)[1:], dtype=torch.long)
    has_length = (tails.norm(dim=-1, keepdim=True) > 0).to(tails)
    new_tails = tails + tail_moves * has_length
    carried = carried_offsets(offsets, tails, new_tails, parents)
    hangs = ((offsets[..., 1:, :] - tails[..., parent, :]).norm(dim=-1, keepdim=True) < _AT_TAIL_M).to(tails)
    free = torch.cat([torch.zeros_like(hangs[..., :1, :]), 1 - hangs], dim=-2)
    return carried + head_moves * free, new_tails


def realign(
    heads: Tensor, rotations: Tensor, tails: Tensor, new_offsets: Tensor, new_tails: Tensor, parents: np.ndarray
) -> tuple[Tensor, Tensor]:
    """The motion on another rest pose: from the root outwards, each bone is turned by the smallest rotation that
    points its new tail at the old tail's position in the world (PC-MRL 3.4).

    Args:
        heads: (..., T, J, 3) joints of the motion in the world. rotations: (..., T, J, 4) global, xyzw.
        tails: (..., J, 3) of the old rest pose. new_offsets, new_tails: (..., J, 3) of the new one.
        parents: (J,), parents before children; joint 0 does not move.

    Returns: heads (..., T, J, 3) and global rotations (..., T, J, 4).
    """
    old_tails, tips, steps = (each.unsqueeze(-3) for each in (tails, new_tails, new_offsets))
    targets = heads + rotate(rotations, old_tails.expand_as(heads))
    out_heads: list[Tensor] = []
    out_rotations: list[Tensor] = []
    for joint in range(len(parents)):
        turn, head = rotations[..., joint, :], heads[..., joint, :]
        if joint:
            above = int(parents[joint])
            step = steps[..., joint, :].expand_as(head)
            head = out_heads[above] + rotate(out_rotations[above], step)
        aim = rotate(conjugate(turn), targets[..., joint, :] - head)
        mend = smallest_turn(tips[..., joint, :].expand_as(aim), aim)
        out_heads.append(head)
        out_rotations.append(multiply(turn, mend))
    return torch.stack(out_heads, dim=-2), torch.stack(out_rotations, dim=-2)
