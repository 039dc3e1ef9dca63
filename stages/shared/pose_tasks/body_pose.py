"""Poses of a rig's body in batches of windows, and the numbers by which networks read and write them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from stages.shared.kinematics.matrix_poses import columns_of, rotations_of_columns
from stages.shared.kinematics.rotations import conjugate, multiply
from stages.shared.pointcloud.heading import headings_of, turned, yaw_quaternions
from stages.shared.pointcloud.rig import RigBody, pose_heads

ROOT_UNIT_M = 0.1  # an output of 1 moves the root by this much
TURN_UNIT = 0.3  # and a column of a rotation's matrix by this much


@dataclass(frozen=True)
class BodyPose:
    """roots (B, T, 3): the pelvis in the world, metres. rotations (B, T, J, 4): of the body's bones, global, xyzw."""

    roots: Tensor
    rotations: Tensor

    def to(self, device: torch.device) -> BodyPose:
        return BodyPose(self.roots.to(device), self.rotations.to(device))

    def frames(self, part: slice) -> BodyPose:
        """Some of the T frames."""
        return BodyPose(self.roots[:, part], self.rotations[:, part])

    @staticmethod
    def joined(parts: Sequence[BodyPose]) -> BodyPose:
        """The windows of several batches as one."""
        return BodyPose(torch.cat([each.roots for each in parts]), torch.cat([each.rotations for each in parts]))

    def heads(self, body: RigBody) -> Tensor:
        """(B, T, J, 3) metres."""
        return pose_heads(body, self.roots, self.rotations)

    def placed(self, yaw: Tensor, centre: Tensor) -> BodyPose:
        """The windows with `centre` (B, 3) moved to the origin, then turned about Y by `yaw` (B,) radians."""
        turn = yaw_quaternions(yaw)[:, None, None, :]
        return BodyPose(turned(self.roots - centre[:, None], yaw[:, None]), multiply(turn, self.rotations))

    def back(self, yaw: Tensor, centre: Tensor) -> BodyPose:
        """The inverse of `placed`."""
        turn = yaw_quaternions(-yaw)[:, None, None, :]
        return BodyPose(turned(self.roots, -yaw[:, None]) + centre[:, None], multiply(turn, self.rotations))


def placing_of(pose: BodyPose, body: RigBody, given: Tensor) -> tuple[Tensor, Tensor]:
    """The yaw (B,) that turns each window's mean heading to +Z, and the mean root (B, 3), over the frames `given`.

    given: (B, T) bool, at least one True in every row.
    """
    weight = given.to(pose.roots.dtype)
    centre = (pose.roots * weight.unsqueeze(-1)).sum(1) / weight.sum(1, keepdim=True)
    groups = body.groups.to(pose.roots.device).expand(len(pose.roots), -1)
    yaw = headings_of(pose.heads(body), groups, given)
    return torch.atan2((yaw.sin() * weight).sum(1), (yaw.cos() * weight).sum(1)), centre


def pose_features(pose: BodyPose, body: RigBody) -> Tensor:
    """(B, T, 3 + 9 J) numbers of a pose: the root, two columns of each rotation's matrix, each head from the root."""
    heads = pose.heads(body) - pose.roots.unsqueeze(-2)
    return torch.cat([pose.roots, columns_of(pose.rotations).flatten(2), heads.flatten(2)], dim=-1)


def pose_of_outputs(outputs: Tensor, base: BodyPose) -> BodyPose:
    """The pose that a network's outputs (B, T, 3 + 6 J) make of a base pose; outputs of zero give the base."""
    roots = base.roots + ROOT_UNIT_M * outputs[..., :3]
    columns = columns_of(base.rotations) + TURN_UNIT * outputs[..., 3:].unflatten(-1, (-1, 6))
    return BodyPose(roots, rotations_of_columns(columns))


def pose_from_root(outputs: Tensor, base: BodyPose) -> BodyPose:
    """As `pose_of_outputs`, with rotations below the root relative to the root's, whose outputs count three times.

    A body that faces elsewhere than the base then differs from it in the root's rotation only.
    """
    turns = outputs[..., 3:].unflatten(-1, (-1, 6))
    root = rotations_of_columns(columns_of(base.rotations[..., :1, :]) + 3 * TURN_UNIT * turns[..., :1, :])
    relative = multiply(conjugate(base.rotations[..., :1, :]), base.rotations[..., 1:, :])
    below = rotations_of_columns(columns_of(relative) + TURN_UNIT * turns[..., 1:, :])
    rotations = torch.cat([root, multiply(root, below)], dim=-2)
    return BodyPose(base.roots + ROOT_UNIT_M * outputs[..., :3], rotations)


def outputs_of(body: RigBody) -> int:
    """Number of outputs that `pose_of_outputs` reads for a frame."""
    return 3 + 6 * len(body.joints)
