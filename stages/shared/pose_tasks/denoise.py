"""The tasks `denoise` (PUMPS 5.2) and `repair`: noisy poses of one rig in, clean poses out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from stages.shared.humanoid.symmetric_pairs import pairs_of_limbs
from stages.shared.kinematics.forward import global_rotations, local_rotations
from stages.shared.pointcloud.rig import Rig
from stages.shared.pose_tasks.body_pose import BodyPose, placing_of, pose_features
from stages.shared.pose_tasks.noise import CAPTURE, NOISES, SWAPPED, check_pairs
from stages.shared.pose_tasks.task import PoseTask, TaskBatch
from stages.shared.solve.robust_smoothing import mend_poses


@dataclass(frozen=True)
class SeenNoise:
    """What the network sees of noisy windows: features, given (B, T), the base, and how they were placed."""

    features: Tensor
    given: Tensor
    base: BodyPose
    yaw: Tensor
    centre: Tensor


class DenoiseTask(PoseTask):
    """Noise from a preset of `noise.py`; the network's outputs are added to the noisy pose itself."""

    name: ClassVar[str] = "denoise"
    corruptions: ClassVar[tuple[str, ...]] = tuple(NOISES)

    def __init__(self, rig: Rig, corruption: str | None = None):
        super().__init__(rig, corruption)
        self.limbs = limbs_of_rig(rig)
        if self.corruption == SWAPPED:
            check_pairs(self.limbs)

    @property
    def notes(self) -> list[str]:
        if self.corruption != CAPTURE or self.limbs:
            return []
        return ["The rig has no pairs of left and right joints, so the noise exchanges none."]

    @property
    def features(self) -> int:
        return 3 + 9 * len(self.rig.body.joints)

    def see(self, noisy: BodyPose, given: Tensor, mended: BodyPose | None = None) -> SeenNoise:
        """The network's input for noisy windows; frames that are not `given` (B, T) are not read.

        mended: the same windows after `mend_poses`, which only `repair` looks at.
        """
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
            NOISES[self.corruption](root, turn, row, self.limbs)[:2]
            for root, turn, row in zip(clean.roots.numpy(), local, rows, strict=True)
        ]
        return pose_of_local(made, parents)


class RepairTask(DenoiseTask):
    """The same noise, after `mend_poses`: the network learns to correct what `mend_poses` leaves, such as drifts."""

    name: ClassVar[str] = "repair"

    @property
    def features(self) -> int:
        return 2 * super().features

    def see(self, noisy: BodyPose, given: Tensor, mended: BodyPose | None = None) -> SeenNoise:
        mended = self.mended(noisy) if mended is None else mended
        yaw, centre = placing_of(mended, self.rig.body, given)
        parts = [pose.placed(yaw, centre) for pose in (noisy, mended)]
        features = torch.cat([pose_features(pose, self.rig.body) for pose in parts], dim=-1)
        return SeenNoise(features, given, parts[1], yaw, centre)

    def mended(self, noisy: BodyPose) -> BodyPose:
        """Each window mended by itself."""
        parents = self.rig.body.parents
        local = local_rotations(noisy.rotations, parents).numpy()
        found = [
            mend_poses(turn, root, limbs=self.limbs) for root, turn in zip(noisy.roots.numpy(), local, strict=True)
        ]
        return pose_of_local([(each.positions, each.local) for each in found], parents)


def pose_of_local(parts: Sequence[tuple[np.ndarray, np.ndarray]], parents: np.ndarray) -> BodyPose:
    """Roots (T, 3) and local rotations (T, J, 4) of each window as one pose."""
    roots = torch.from_numpy(np.stack([roots for roots, _ in parts])).float()
    local = torch.from_numpy(np.stack([local for _, local in parts])).float()
    return BodyPose(roots, global_rotations(local, parents))


def limbs_of_rig(rig: Rig) -> tuple[np.ndarray, ...]:
    """Pairs (P, 2) of left and right bones of the arms and of the legs, among the bones of the rig's body."""
    skeleton, joints = rig.skeleton, rig.body.joints
    place = {int(joint): bone for bone, joint in enumerate(joints)}
    limbs = pairs_of_limbs(skeleton.names, skeleton.parents, skeleton.offsets, skeleton.groups)
    inside = [
        [[place[int(j)] for j in pair] for pair in limb if all(int(j) in place for j in pair)] for limb in limbs
    ]
    return tuple(np.array(limb) for limb in inside if limb)
