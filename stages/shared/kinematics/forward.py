"""Forward kinematics and its inverse: global rotations and root position to joint positions (PC-MRL eq. 1).

Plain functions on torch tensors with any leading dimensions; xyzw quaternions; pass NumPy arrays with
`torch.from_numpy`.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.kinematics.rotations import conjugate, multiply, rotate


def local_rotations(rotations: Tensor, parents: np.ndarray) -> Tensor:
    """Global rotations (..., J, 4) to rotations in the parent's frame, (..., J, 4). Joint 0 keeps its own."""
    child = torch.as_tensor(np.asarray(parents)[1:], dtype=torch.long, device=rotations.device)
    inverse_parent = conjugate(rotations[..., child, :])
    local = multiply(inverse_parent, rotations[..., 1:, :])
    return torch.cat([rotations[..., :1, :], local], dim=-2)


def global_rotations(local: Tensor, parents: np.ndarray) -> Tensor:
    """Rotations in the parent's frame (..., J, 4) to global ones, (..., J, 4)."""
    out: list[Tensor] = [local[..., 0, :]]
    for joint in range(1, local.shape[-2]):
        out.append(multiply(out[int(parents[joint])], local[..., joint, :]))
    return torch.stack(out, dim=-2)


def joint_positions(rotations: Tensor, root_positions: Tensor, offsets: Tensor, parents: np.ndarray) -> Tensor:
    """Heads of all joints in the world, by p_n = p_m + R_m H_n (PC-MRL eq. 1).

    Args:
        rotations: (..., J, 4) global, xyzw.
        root_positions: (..., 3) of joint 0, metres.
        offsets: (J, 3) or (..., J, 3), each joint's head in its parent's frame.
        parents: (J,), parents before children.

    Returns: (..., J, 3) metres.
    """
    lead = rotations.shape[:-2]
    parent = torch.as_tensor(np.asarray(parents)[1:], dtype=torch.long, device=rotations.device)
    offsets = offsets.to(rotations).expand(*lead, -1, 3)[..., 1:, :]
    steps = rotate(rotations[..., parent, :], offsets)
    out: list[Tensor] = [root_positions.to(rotations)]
    for joint in range(1, rotations.shape[-2]):
        out.append(out[int(parents[joint])] + steps[..., joint - 1, :])
    return torch.stack(out, dim=-2)


def offsets_over_time(skeleton: Skeleton, motion: Motion) -> Tensor:
    """(J, 3), or (T, J, 3) if the motion has translation tracks; float32 metres."""
    rest = torch.as_tensor(skeleton.offsets, dtype=torch.float32)
    if len(motion.track_joints) == 0:
        return rest
    moving = rest.expand(motion.frames, -1, 3).clone()
    moving[:, torch.as_tensor(motion.track_joints, dtype=torch.long)] = torch.as_tensor(motion.tracks)
    return moving


def positions_of(skeleton: Skeleton, motion: Motion) -> np.ndarray:
    """(T, J, 3) float32 joint heads of a motion, metres, in the world."""
    positions = joint_positions(
        torch.as_tensor(motion.rotations),
        torch.as_tensor(motion.root_positions),
        offsets_over_time(skeleton, motion),
        skeleton.parents,
    )
    return positions.numpy()
