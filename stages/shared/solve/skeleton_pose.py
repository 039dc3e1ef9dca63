"""Frames of a skeleton's pose: the type that filling, the solve, easing and foot lock take and return.

A motion from a file becomes a pose once (`SkeletonPose.of_motion`) and a motion again once (`SkeletonPose.motion`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import torch
from torch import Tensor

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.kinematics.forward import global_rotations, joint_positions, local_rotations, offsets_over_time
from stages.shared.kinematics.frame_blocks import blocks_of, in_blocks
from stages.shared.kinematics.joint_tree import pelvis_and_above
from stages.shared.kinematics.plain_interpolation import (
    Glide,
    Smoothness,
    interpolate_pose,
)
from stages.shared.kinematics.rotations import conjugate, from_turn_vectors, multiply, rotate, signs_after_given

_JOINTS_AT_ONCE = 4  # whose signs are computed together


@dataclass(frozen=True, eq=False)
class SkeletonPose:
    """T frames of a skeleton, float32.

    A pose stores its joints' rotations in one of two forms, global or local. The other form is computed on first use
    and then kept.

    skeleton:     the skeleton with its J joints.
    held:         (T, J, 4) rotations, xyzw.
    is_global:    True where `held` are global rotations; False where they are in the parents' frames.
    roots:        (T, 3) joint 0 in the world, metres.
    offsets:      (T, J, 3) joints' heads in their parents' frames, metres; (J, 3) if no head except joint 0's moves.
    track_joints: (K,) joints whose offsets vary over time.
    """

    skeleton: Skeleton
    held: Tensor
    is_global: bool
    roots: Tensor
    offsets: Tensor
    track_joints: np.ndarray

    @classmethod
    def of_motion(cls, skeleton: Skeleton, motion: Motion, device: torch.device | str = "cpu") -> SkeletonPose:
        """All frames of a motion, stored as its own global rotations."""
        held = torch.as_tensor(np.ascontiguousarray(motion.rotations), dtype=torch.float32)
        roots = torch.as_tensor(np.ascontiguousarray(motion.root_positions), dtype=torch.float32)
        offsets = offsets_over_time(skeleton, motion)
        return cls(skeleton, held.to(device), True, roots.to(device), offsets.to(device), motion.track_joints)

    def motion(self, fps: float) -> Motion:
        """The same frames as a motion of `fps` frames a second."""
        tracks = np.zeros((len(self), 0, 3), np.float32)
        if len(self.track_joints):
            tracks = self.offsets[:, self._tracked].cpu().numpy()
        return Motion(self.rotations.cpu().numpy(), self.roots.cpu().numpy(), fps, self.track_joints, tracks)

    def __len__(self) -> int:
        return len(self.roots)

    @cached_property
    def rotations(self) -> Tensor:
        """(T, J, 4) global rotations, xyzw."""
        if self.is_global:
            return self.held
        return in_blocks(lambda held: global_rotations(held, self.skeleton.parents), self.held)

    @cached_property
    def local(self) -> Tensor:
        """(T, J, 4) rotations in the parents' frames, xyzw."""
        if not self.is_global:
            return self.held
        return in_blocks(lambda held: local_rotations(held, self.skeleton.parents), self.held)

    @cached_property
    def heads(self) -> Tensor:
        """(T, J, 3) joints' heads in the world, metres."""
        parents = self.skeleton.parents
        if self.moves:
            return in_blocks(partial(joint_positions, parents=parents), self.rotations, self.roots, self.offsets)
        return in_blocks(partial(joint_positions, offsets=self.offsets, parents=parents), self.rotations, self.roots)

    def world(self) -> tuple[Tensor, Tensor]:
        """Heads (T, J, 3) and global rotations (T, J, 4)."""
        return self.heads, self.rotations

    @property
    def parts(self) -> tuple[Tensor, Tensor, Tensor]:
        """Local rotations, roots and offsets, as `interpolate_pose` and `solve_pose` take them."""
        return self.local, self.roots, self.offsets

    @property
    def moves(self) -> bool:
        """True where offsets vary over time."""
        return self.offsets.dim() == 3

    @property
    def _tracked(self) -> Tensor:
        return torch.as_tensor(self.track_joints, dtype=torch.long, device=self.roots.device)

    def by_local(self) -> SkeletonPose:
        """The same frames stored as local rotations. Global rotations are then computed along the chains, as in the
        solve, and differ by rounding from those stored before."""
        return replace(self, held=self.local, is_global=False)

    def with_local(self, local: Tensor, roots: Tensor, offsets: Tensor) -> SkeletonPose:
        """Other frames of the same skeleton, stored as local rotations (T, J, 4)."""
        return replace(self, held=local, is_global=False, roots=roots, offsets=offsets)

    def rows(self, index: Tensor | np.ndarray | slice) -> SkeletonPose:
        """Some of the frames."""
        if isinstance(index, np.ndarray):
            index = torch.as_tensor(index, device=self.roots.device)
        offsets = self.offsets[index] if self.moves else self.offsets
        return replace(self, held=self.held[index], roots=self.roots[index], offsets=offsets)

    def to(self, device: torch.device | str) -> SkeletonPose:
        """The same on a device."""
        held, roots, offsets = (part.to(device) for part in (self.held, self.roots, self.offsets))
        return replace(self, held=held, roots=roots, offsets=offsets)

    def at(
        self, key_times: Tensor, times: Tensor, smooth: Smoothness = 0.0, glide: Glide | None = None
    ) -> SkeletonPose:
        """The plain interpolation of this pose's frames, used as keys, at other times; `glide` sets how it continues
        beyond the keys, in their unit."""
        whole_turns = torch.from_numpy(pelvis_and_above(self.skeleton.parents, self.skeleton.root))
        made = interpolate_pose(*self.parts, key_times, times, smooth=smooth, glide=glide, whole_turns=whole_turns)
        return self.with_local(*made)

    def corrected(self, turns: Tensor, shifts: Tensor) -> SkeletonPose:
        """Every joint turned in its own frame and the pelvis shifted in the world.

        Args:
            turns: (T, J, 3) rotation vectors, radians.
            shifts: (T, 3) metres. They are added to the pelvis if it is one of `track_joints`, otherwise to joint 0,
                above which nothing moves.
        """
        skeleton, root = self.skeleton, self.skeleton.root
        local = in_blocks(lambda own, added: multiply(own, from_turn_vectors(added)), self.local, turns)
        if root == 0 or root not in self.track_joints.tolist():
            return self.with_local(local, self.roots + shifts, self.offsets)
        lead = root + 1  # the pelvis' ancestors are among these
        above = global_rotations(local[:, :lead], skeleton.parents[:lead])[:, int(skeleton.parents[root])]
        offsets = self.offsets.expand(len(local), -1, 3).clone()
        offsets[:, root] += rotate(conjugate(above), shifts)
        return self.with_local(local, self.roots, offsets)

    def with_rows(self, rows: np.ndarray, others: SkeletonPose) -> SkeletonPose:
        """The same frames, of which `rows` (M,) come from the M frames of `others`; all other values stay the same.

        The result is stored as global rotations on this pose's device. Those from `others` agree in sign with the
        frame before them; offsets of joints that are not in `track_joints` stay this pose's own.
        """
        others = others.to(self.roots.device)
        rotations, roots, offsets = self.rotations.clone(), self.roots.clone(), self.offsets
        at = torch.as_tensor(rows, device=roots.device)
        rotations[at], roots[at] = others.rotations, others.roots
        if len(self.track_joints):
            offsets = offsets.clone()
            offsets[at[:, None], self._tracked] = others.offsets[:, self._tracked]
        given = np.ones(len(self), bool)
        given[rows] = False
        for joints in blocks_of(rotations.shape[1], _JOINTS_AT_ONCE):  # signs of a joint follow from it alone
            signed = signs_after_given(rotations[:, joints].cpu().numpy(), given)
            rotations[:, joints] = torch.from_numpy(signed).to(rotations)
        return replace(self, held=rotations, is_global=True, roots=roots, offsets=offsets)


def pose_of_motion(skeleton: Skeleton, motion: Motion, device: torch.device | str = "cpu") -> SkeletonPose:
    """All frames of a motion, stored as local rotations."""
    return SkeletonPose.of_motion(skeleton, motion).by_local().to(device)


def replace_rows(skeleton: Skeleton, motion: Motion, pose: SkeletonPose, rows: np.ndarray) -> Motion:
    """A motion with the same number of frames: `rows` come from `pose`, the others are copied from the motion."""
    return SkeletonPose.of_motion(skeleton, motion).with_rows(rows, pose).motion(motion.fps)
