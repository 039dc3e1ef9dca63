"""A motion in its local form, as interpolation and the solve change it, and back."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import roma
import torch
from torch import Tensor

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.kinematics.forward import global_rotations, joint_positions, local_rotations, offsets_over_time
from stages.shared.kinematics.plain_interpolation import Glide, Smoothness, interpolate_pose


class LocalPose(NamedTuple):
    """Frames of a skeleton in its parents' frames.

    local:   (T, J, 4) rotations, xyzw.
    roots:   (T, 3) joint 0 in the world, metres.
    offsets: (T, J, 3), or (J, 3) where the motion has no translation tracks.
    """

    local: Tensor
    roots: Tensor
    offsets: Tensor

    def rows(self, index: Tensor | slice) -> LocalPose:
        """Some of the frames."""
        return LocalPose(self.local[index], self.roots[index], self.offsets[index] if self.moves else self.offsets)

    @property
    def moves(self) -> bool:
        """True where offsets vary over time."""
        return self.offsets.dim() == 3

    def at(self, key_times: Tensor, times: Tensor, smooth: Smoothness = 0.0, glide: Glide | None = None) -> LocalPose:
        """This pose's frames taken as keys, interpolated plainly to other times, and beyond the keys as `glide` has
        it, in their unit."""
        return LocalPose(*interpolate_pose(*self, key_times, times, smooth=smooth, glide=glide))

    def world(self, parents: np.ndarray) -> tuple[Tensor, Tensor]:
        """Heads (T, J, 3) and global rotations (T, J, 4)."""
        rotations = global_rotations(self.local, parents)
        return joint_positions(rotations, self.roots, self.offsets, parents), rotations


def pose_of_motion(skeleton: Skeleton, motion: Motion, device: torch.device | str = "cpu") -> LocalPose:
    """All frames of a motion as a local pose, float32."""
    rotations = torch.as_tensor(np.ascontiguousarray(motion.rotations), dtype=torch.float32)
    local = local_rotations(rotations, skeleton.parents)
    roots = torch.as_tensor(np.ascontiguousarray(motion.root_positions), dtype=torch.float32)
    return LocalPose(*(part.to(device) for part in (local, roots, offsets_over_time(skeleton, motion))))


def correct_pose(
    pose: LocalPose, turns: Tensor, shifts: Tensor, skeleton: Skeleton, track_joints: np.ndarray
) -> LocalPose:
    """A pose with every joint turned in its own frame and the pelvis shifted in the world.

    Args:
        turns: (T, J, 3) rotation vectors, radians. shifts: (T, 3) metres.
        track_joints: joints whose position the motion stores. The shift goes to the pelvis where that is one of
            them, else to joint 0, above which nothing moves.
    """
    local = roma.quat_product(pose.local, roma.rotvec_to_unitquat(turns))
    root = skeleton.root
    if root == 0 or root not in track_joints.tolist():
        return LocalPose(local, pose.roots + shifts, pose.offsets)
    lead = root + 1  # the pelvis' ancestors are among these
    above = global_rotations(local[:, :lead], skeleton.parents[:lead])[:, int(skeleton.parents[root])]
    offsets = pose.offsets.expand(len(local), -1, 3).clone()
    offsets[:, root] += roma.quat_action(roma.quat_conjugation(above), shifts)
    return LocalPose(local, pose.roots, offsets)


def replace_rows(skeleton: Skeleton, motion: Motion, pose: LocalPose, rows: np.ndarray) -> Motion:
    """A motion of as many frames: `rows` come from `pose`, the others are the motion's own, value for value.

    Rows from the pose are sign-continuous in time with what comes before them.
    """
    _, rotations = pose.world(skeleton.parents)
    out, roots, tracks = (np.array(a, np.float32) for a in (motion.rotations, motion.root_positions, motion.tracks))
    out[rows], roots[rows] = rotations.cpu().numpy(), pose.roots.cpu().numpy()
    if len(motion.track_joints):
        tracks[rows] = pose.offsets[:, torch.as_tensor(motion.track_joints, dtype=torch.long)].cpu().numpy()
    given = np.ones(motion.frames, bool)
    given[rows] = False
    _continue_signs(out, given)
    return Motion(out, roots, motion.fps, motion.track_joints, tracks)


def _continue_signs(rotations: np.ndarray, given: np.ndarray) -> None:
    """Flip filled rows in place so that each agrees with the row before it; given rows keep their signs."""
    disagree = (rotations[1:] * rotations[:-1]).sum(-1) < 0
    sign = np.ones(rotations.shape[1:-1], np.float32)
    for row in range(1, len(rotations)):
        sign = np.where(given[row], 1.0, np.where(disagree[row - 1], -sign, sign)).astype(np.float32)
        if not given[row]:
            rotations[row] *= sign[:, None]
