"""Poses of a rig with left and right exchanged, for rigs that are built alike on both sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from stages.shared.humanoid.symmetric_pairs import find_pairs
from stages.shared.pointcloud.rig import Rig
from stages.shared.pose_tasks.body_pose import BodyPose

_ALIKE = 0.06  # of the longest bone: larger differences between left and right are of build


@dataclass(frozen=True)
class Mirror:
    """other: (J,) for each bone of the body the one on the other side, or itself.

    axis: X (0) or Z (2), across which the rig is built alike; a world mirrored at either has gravity where it was.
    """

    other: np.ndarray
    axis: int

    def mirrored(self, pose: BodyPose, chosen: Tensor) -> BodyPose:
        """The windows with `chosen` (B,) True seen in a mirror, left and right exchanged."""
        flip = torch.ones(3)
        flip[self.axis] = -1.0
        # A mirror at X = 0 turns rotations about X the same way, and those about Y and Z the other way.
        rotations = pose.rotations[:, :, self.other] * torch.cat([-flip, torch.ones(1)])
        roots = pose.roots * flip
        gate = chosen.view(-1, 1, 1)
        return BodyPose(
            torch.where(gate, roots, pose.roots), torch.where(gate.unsqueeze(-1), rotations, pose.rotations)
        )


def mirror_of_rig(rig: Rig) -> Mirror | None:
    """The mirror of a rig whose bones at zero rotation are alike on both sides of X = 0 or of Z = 0, else None."""
    skeleton, joints = rig.skeleton, rig.body.joints
    partner = np.arange(skeleton.joints)
    for left, right in find_pairs(skeleton.names, skeleton.parents, skeleton.offsets, skeleton.groups):
        partner[left], partner[right] = right, left
    place = {int(joint): bone for bone, joint in enumerate(joints)}
    if any(int(partner[joint]) not in place for joint in joints):
        return None
    body = joints[1:]
    longest = float(np.linalg.norm(skeleton.offsets[body], axis=1).max())
    other = np.array([place[int(partner[joint])] for joint in joints])
    for axis in (0, 2):
        flip = np.ones(3)
        flip[axis] = -1.0
        apart = skeleton.offsets[body] * flip - skeleton.offsets[partner[body]]
        if np.abs(apart).max() <= _ALIKE * longest + 1e-9 and (other != np.arange(len(other))).any():
            return Mirror(other, axis)
    return None
