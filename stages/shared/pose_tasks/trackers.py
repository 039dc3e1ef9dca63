"""The task `trackers`: the head and both hands, as a headset and two controllers track them, to the whole body."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from data_schemas.errors import InputError
from stages.shared.kinematics.matrix_poses import columns_of
from stages.shared.kinematics.rotations import conjugate, multiply, rotate
from stages.shared.networks.pcmrl.skeleton_losses import end_bones
from stages.shared.pointcloud.heading import yaw_quaternions
from stages.shared.pointcloud.rig import Rig, pose_heads
from stages.shared.pose_tasks.body_pose import BodyPose
from stages.shared.pose_tasks.task import PoseTask, TaskBatch

_JITTER_M = 0.005  # of `jitter`, the largest standard deviation of a tracker's position


class TrackersTask(PoseTask):
    """Positions, velocities and rotations of three bones in; the base is the rest pose under the head, facing as it
    does. `exact` has trackers without error, `jitter` adds noise of up to 5 mm to their positions."""

    name: ClassVar[str] = "trackers"
    corruptions: ClassVar[tuple[str, ...]] = ("exact", "jitter")

    def __init__(self, rig: Rig, corruption: str | None = None):
        super().__init__(rig, corruption)
        body = rig.body
        groups, weights = body.groups.numpy(), body.weights.numpy()
        ends = end_bones(body.parents, groups, body.tails.numpy(), weights)[:3]
        last = [np.flatnonzero((groups == group) & (weights > 0))[-1:] for group in range(3)]
        if not all(len(each) for each in last):
            raise InputError("The rig lacks a head or an arm.", "Trackers need bones of the spine and of both arms.")
        self.bones = [end if end >= 0 else int(each[0]) for end, each in zip(ends, last, strict=True)]
        self._rest = pose_heads(body, torch.zeros(3), body.rest_world)[self.bones[0]]  # the head from the pelvis

    @property
    def features(self) -> int:
        return 3 * (3 + 3 + 6)

    def see(self, places: Tensor, rotations: Tensor) -> tuple[Tensor, BodyPose, Tensor, Tensor]:
        """Features (B, T, 36), base, and the yaw (B,) and centre (B, 3) of the placing, from the trackers' positions
        (B, T, 3, 3) metres and global rotations (B, T, 3, 4), head, left and right hand."""
        rest = self.rig.body.rest_world
        turn = multiply(rotations[:, :, 0], conjugate(rest[self.bones[0]]))
        heading = 2 * torch.atan2(turn[..., 1], turn[..., 3])  # (B, T)
        base_turns = multiply(yaw_quaternions(heading).unsqueeze(2), rest.expand(*heading.shape, -1, 4))
        roots = places[:, :, 0] - rotate(yaw_quaternions(heading), self._rest.expand(*heading.shape, 3))
        yaw = -torch.atan2(heading.sin().sum(1), heading.cos().sum(1))
        centre = places[:, :, 0].mean(1) * torch.tensor([1.0, 0.0, 1.0])
        base = BodyPose(roots, base_turns).placed(yaw, centre)
        back = yaw_quaternions(yaw)[:, None, None]
        placed = rotate(back, places - centre[:, None, None])
        speed = F.pad(placed[:, 1:] - placed[:, :-1], (0, 0, 0, 0, 1, 0))
        parts = (placed, 30 * speed, columns_of(multiply(back, rotations)))
        return torch.cat([part.flatten(2) for part in parts], dim=-1), base, yaw, centre

    def draw(self, clean: BodyPose, valid: Tensor, rows: Sequence[np.random.Generator]) -> TaskBatch:
        places = clean.heads(self.rig.body)[:, :, self.bones]
        if self.corruption == "jitter":
            noise = np.stack([row.uniform(0, _JITTER_M) * row.standard_normal(places.shape[1:]) for row in rows])
            places = places + torch.from_numpy(noise).float()
        features, base, yaw, centre = self.see(places, clean.rotations[:, :, self.bones])
        return TaskBatch(features, valid, base, clean.placed(yaw, centre), valid)
