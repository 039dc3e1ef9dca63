"""Plain interpolation and prediction, the baselines of every figure. All windows of a batch are filled at once.

- lerp: joints' global positions and quaternions on straight lines between keys; bones may shrink on the way.
- slerp: local rotations on great circles, root and translation tracks on straight lines, then forward kinematics.
- cubic: as slerp, with tangents that neighbouring segments share.
- damped: cubic in short gaps, slerp in long ones. Filling starts from it, so models add corrections to it.
- zero velocity, constant velocity: for prediction, which has no key at the end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.forward import (
    global_rotations,
    joint_positions,
    local_rotations,
    offsets_over_time,
)
from stages.shared.kinematics.joint_tree import pelvis_and_above
from stages.shared.kinematics.plain_interpolation import (
    Smoothness,
    damped_smoothness,
    interpolate_pose,
)
from stages.shared.kinematics.rotations import continuous_signs, from_turn_vectors, multiply, turns_between


@dataclass(frozen=True)
class Poses:
    """B windows of T frames on one skeleton, float32.

    rotations: (B, T, J, 4) global; roots: (B, T, 3) of joint 0; offsets: (B, T, J, 3); parents: (J,);
    positions: (B, T, J, 3), the joints in the world; pelvis: index of the pelvis joint.
    """

    rotations: Tensor
    roots: Tensor
    offsets: Tensor
    positions: Tensor
    parents: np.ndarray
    pelvis: int = 0

    @classmethod
    def of(cls, skeleton: Skeleton, motions: list[Motion]) -> Poses:
        """The windows of one skeleton, all of one length."""
        rotations = torch.stack([torch.as_tensor(m.rotations) for m in motions])
        roots = torch.stack([torch.as_tensor(m.root_positions) for m in motions])
        steady = [offsets_over_time(skeleton, m).expand(m.frames, -1, 3) for m in motions]
        return cls.from_joints(rotations, roots, torch.stack(steady), skeleton.parents, skeleton.root)

    @classmethod
    def from_joints(
        cls, rotations: Tensor, roots: Tensor, offsets: Tensor, parents: np.ndarray, pelvis: int = 0
    ) -> Poses:
        """Poses from global rotations, with positions by forward kinematics."""
        return cls(rotations, roots, offsets, joint_positions(rotations, roots, offsets, parents), parents, pelvis)

    def local(self) -> Tensor:
        """(B, T, J, 4) rotations in the parents' frames."""
        return local_rotations(self.rotations, self.parents)


Filled = tuple[np.ndarray, np.ndarray]
"""Filled windows: global positions (B, T, J, 3) and quaternions (B, T, J, 4). A baseline reads only known frames."""


def lerp(poses: Poses, known: np.ndarray) -> Filled:
    """Linear interpolation in the world; quaternions are normalised again. known: (T,) bool."""
    keys = np.flatnonzero(known)
    share = torch.as_tensor(_line_weights(keys, len(known)), dtype=torch.float32)
    quaternions = continuous_signs(poses.rotations[:, keys], axis=1)
    rotations = torch.einsum("tk,bkjc->btjc", share, quaternions)
    positions = torch.einsum("tk,bkjc->btjc", share, poses.positions[:, keys])
    return positions.numpy(), torch.nn.functional.normalize(rotations, dim=-1).numpy()


def slerp(poses: Poses, known: np.ndarray) -> Filled:
    """Spherical interpolation of local rotations."""
    return _interpolated(poses, known, smooth=0.0)


def cubic(poses: Poses, known: np.ndarray) -> Filled:
    """A smooth version of slerp, without kinks at the keys."""
    return _interpolated(poses, known, smooth=1.0)


def damped(poses: Poses, known: np.ndarray) -> Filled:
    """The plain interpolation that filling starts from: cubic in short gaps, slerp in long ones."""
    keys = torch.as_tensor(np.flatnonzero(known), dtype=torch.float64)
    return _interpolated(poses, known, smooth=damped_smoothness(keys, MODEL_FPS))


def zero_velocity(poses: Poses, known: np.ndarray) -> Filled:
    """The last known frame is held."""
    held = np.maximum.accumulate(np.where(known, np.arange(len(known)), 0))
    return poses.positions[:, held].numpy(), poses.rotations[:, held].numpy()


def constant_velocity(poses: Poses, known: np.ndarray) -> Filled:
    """The step between the last two known frames is repeated, in local rotations and translations."""
    last = int(np.flatnonzero(known)[-1])
    steps = torch.arange(len(known), dtype=torch.float32) - last
    steps = torch.where(torch.as_tensor(known), 0.0, steps).clamp(min=0)
    anchor = torch.as_tensor(np.where(known, np.arange(len(known)), last))
    local = poses.local()
    turn = turns_between(local[:, last - 1], local[:, last])
    advanced = from_turn_vectors(turn[:, None] * steps[None, :, None, None])
    rotations = global_rotations(multiply(local[:, anchor], advanced), poses.parents)
    roots = poses.roots[:, anchor] + (poses.roots[:, last] - poses.roots[:, last - 1])[:, None] * steps[:, None]
    drift = (poses.offsets[:, last] - poses.offsets[:, last - 1])[:, None]
    offsets = poses.offsets[:, anchor] + drift * steps[:, None, None]
    return _arrays(Poses.from_joints(rotations, roots, offsets, poses.parents))


BASELINES: dict[str, Callable[[Poses, np.ndarray], Filled]] = {
    "lerp": lerp,
    "slerp": slerp,
    "cubic": cubic,
    "damped": damped,
}
PREDICTION_BASELINES: dict[str, Callable[[Poses, np.ndarray], Filled]] = {
    "zero-velocity": zero_velocity,
    "constant-velocity": constant_velocity,
}


def _interpolated(poses: Poses, known: np.ndarray, smooth: Smoothness) -> Filled:
    """All windows in one call: joints are interpolated independently, so the joints of all windows are interpolated
    as one set."""
    keys = np.flatnonzero(known)
    batch, frames, joints = poses.rotations.shape[:3]
    local = _windows_as_joints(poses.local()[:, keys])
    # The root's position is one more offset of every window.
    offsets = _windows_as_joints(torch.cat([poses.offsets[:, keys], poses.roots[:, keys, None]], dim=2))
    key_times = torch.as_tensor(keys, dtype=torch.float64)
    times = torch.arange(frames, dtype=torch.float64)
    whole_turns = torch.from_numpy(pelvis_and_above(poses.parents, poses.pelvis)).repeat(batch)
    local, _, offsets = interpolate_pose(
        local, offsets[:, 0], offsets, key_times, times, smooth=smooth, whole_turns=whole_turns
    )
    offsets = offsets.reshape(frames, batch, joints + 1, 3).transpose(0, 1)
    rotations = global_rotations(local.reshape(frames, batch, joints, 4).transpose(0, 1), poses.parents)
    return _arrays(Poses.from_joints(rotations, offsets[:, :, -1], offsets[:, :, :-1], poses.parents))


def _windows_as_joints(values: Tensor) -> Tensor:
    """(B, K, J, C) to (K, B * J, C)."""
    return values.transpose(0, 1).flatten(1, 2)


def _arrays(poses: Poses) -> Filled:
    return poses.positions.numpy(), poses.rotations.numpy()


def _line_weights(keys: np.ndarray, frames: int) -> np.ndarray:
    """(frames, K) shares of the keys in each frame; before the first and after the last key that key is held."""
    times = np.arange(frames)
    return np.stack([np.interp(times, keys, row) for row in np.eye(len(keys))], axis=1)
