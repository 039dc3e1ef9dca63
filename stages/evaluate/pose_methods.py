"""Methods that fill one skeleton's poses (`pumps train baseline`, `pumps train citl`), measured beside the others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from data_schemas.skeleton import Skeleton
from stages.evaluate.measured_clips import WindowBatch
from stages.evaluate.one_checkpoint import OneCheckpoint
from stages.shared.inference.pose_filling import Interpolator, load_interpolator
from stages.shared.kinematics.forward import local_rotations
from stages.shared.kinematics.rotations import conjugate, multiply, rotate
from stages.shared.pointcloud.bones import body_joints
from stages.shared.statistics.baselines import Filled, Poses, damped


@dataclass(frozen=True)
class LoadedInterpolator(OneCheckpoint):
    """A trained network of one skeleton's poses."""

    interpolator: Interpolator

    def fill(self, batch: WindowBatch, poses: Poses, advance: Callable[[], None]) -> Filled:
        """The batch's windows filled, all at once. Joints that are no bones follow the plain interpolation."""
        skeleton = batch.skeleton
        joints = body_joints(skeleton)
        self._check(skeleton, joints)
        tails = torch.from_numpy(np.asarray(skeleton.tails[joints], np.float32)).expand(len(poses.roots), -1, 3)
        known = torch.from_numpy(batch.known).expand(len(poses.roots), -1)
        bones = self.interpolator.fill(poses.positions[:, :, joints], poses.rotations[:, :, joints], tails, known)
        filled = whole_skeleton(poses, batch.known, joints, bones)
        for _ in batch.windows:
            advance()
        return filled

    def _check(self, skeleton: Skeleton, joints: np.ndarray) -> None:
        place = {int(joint): index for index, joint in enumerate(joints)}
        parents = np.array([place.get(int(skeleton.parents[joint]), -1) for joint in joints])
        self.interpolator.check_hierarchy(parents, np.maximum(skeleton.groups[joints], 0), "the measured skeleton")


def loaded_interpolator(name: str, source: str, device: str) -> LoadedInterpolator:
    """Load it. Raises InputError where the folder holds none."""
    return LoadedInterpolator(name, source, load_interpolator(source, device))


def whole_skeleton(
    poses: Poses, known: np.ndarray, joints: np.ndarray, bones: tuple[torch.Tensor, torch.Tensor]
) -> Filled:
    """All joints of filled windows: `joints` have the transforms of `bones`, and all others keep the place and the
    rotation in their parents that the plain interpolation gives them.

    Args:
        poses: the true windows, of which only known frames are read. known: (T,).
        joints: (B,) joints of the bones. bones: heads (W, T, B, 3) and global rotations (W, T, B, 4).
    """
    places, turns = (torch.from_numpy(part).clone() for part in damped(poses, known))
    local = local_rotations(turns, poses.parents)
    above = torch.as_tensor(np.maximum(poses.parents, 0), dtype=torch.long)
    offsets = rotate(conjugate(turns[:, :, above]), places - places[:, :, above])
    own = {int(joint): index for index, joint in enumerate(joints)}
    for joint, parent in enumerate(poses.parents):
        if joint in own:
            places[:, :, joint], turns[:, :, joint] = (part[:, :, own[joint]] for part in bones)
        elif parent >= 0:
            places[:, :, joint] = places[:, :, parent] + rotate(turns[:, :, parent], offsets[:, :, joint])
            turns[:, :, joint] = multiply(turns[:, :, parent], local[:, :, joint])
    gate = torch.from_numpy(known)[None, :, None, None]
    places, turns = torch.where(gate, poses.positions, places), torch.where(gate, poses.rotations, turns)
    return places.numpy(), turns.numpy()
