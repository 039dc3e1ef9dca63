"""The task `denoise` (PUMPS 5.2): noisy poses of one rig in, clean poses out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from stages.shared.kinematics.forward import global_rotations, local_rotations
from stages.shared.pose_tasks.body_pose import BodyPose, placing_of, pose_features
from stages.shared.pose_tasks.noise import NOISES
from stages.shared.pose_tasks.task import PoseTask, TaskBatch


@dataclass(frozen=True)
class SeenNoise:
    """What the network sees of noisy windows: features, given (B, T), its base, and how the windows were placed."""

    features: Tensor
    given: Tensor
    base: BodyPose
    yaw: Tensor
    centre: Tensor


class DenoiseTask(PoseTask):
    """Noise from a preset of `noise.py`; the network's outputs are added to the noisy pose itself."""

    name: ClassVar[str] = "denoise"
    corruptions: ClassVar[tuple[str, ...]] = tuple(NOISES)

    @property
    def features(self) -> int:
        return 3 + 9 * len(self.rig.body.joints)

    def see(self, noisy: BodyPose, given: Tensor) -> SeenNoise:
        """The network's input for noisy windows; frames that are not `given` (B, T) are not read."""
        yaw, centre = placing_of(noisy, self.rig.body, given)
        placed = noisy.placed(yaw, centre)
        return SeenNoise(pose_features(placed, self.rig.body), given, placed, yaw, centre)

    def draw(self, clean: BodyPose, valid: Tensor, rows: Sequence[np.random.Generator]) -> TaskBatch:
        noisy = self.corrupted(clean, rows)
        seen = self.see(noisy, valid)
        return TaskBatch(seen.features, valid, seen.base, clean.placed(seen.yaw, seen.centre), valid)

    def corrupted(self, clean: BodyPose, rows: Sequence[np.random.Generator]) -> BodyPose:
        """Noise on each window, from its own generator."""
        parents = self.rig.body.parents
        local = local_rotations(clean.rotations, parents).numpy()
        made = [
            NOISES[self.corruption](root, turn, row)
            for root, turn, row in zip(clean.roots.numpy(), local, rows, strict=True)
        ]
        roots = torch.from_numpy(np.stack([each[0] for each in made])).float()
        turns = torch.from_numpy(np.stack([each[1] for each in made])).float()
        return BodyPose(roots, global_rotations(turns, parents))
