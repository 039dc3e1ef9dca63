"""A small body that sways, for measurements."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from data_schemas.skeleton import Motion, Skeleton

NAMES = ("world", "hips", "chest", "head", "arm.L", "arm.R", "leg.L", "leg.R", "twist")

SPINE = [[0, 0, 0], [0, 0.9, 0], [0, 0.3, 0], [0, 0.3, 0]]
LIMBS = [[0.2, 0.2, 0], [-0.2, 0.2, 0], [0.1, 0, 0], [-0.1, 0, 0], [0, 0, 0]]
OFFSETS = np.array(SPINE + LIMBS)


def skeleton(size: float = 1.0) -> Skeleton:
    tails = np.full((9, 3), [0, 0.3, 0]) * size
    tails[0] = tails[8] = 0
    return Skeleton(
        names=NAMES,
        parents=np.array([-1, 0, 1, 2, 2, 2, 1, 1, 4], np.int32),
        offsets=OFFSETS * size,
        tails=tails,
        groups=np.array([-1, 0, 0, 0, 1, 2, 3, 4, 1], np.int8),
        sampled=np.array([0, 1, 1, 1, 1, 1, 1, 1, 0], bool),
        root=1,
    )


def swaying(seed: int, frames: int, fps: float = 30.0) -> Motion:
    rng = np.random.default_rng(seed)
    t = np.arange(frames)[:, None, None] / fps
    rotvecs = 0.6 * np.sin(rng.uniform(1, 6, (1, 9, 3)) * t + rng.uniform(0, 6, (1, 9, 3)))
    rotvecs[:, 0] = 0
    rotations = Rotation.from_rotvec(rotvecs.reshape(-1, 3)).as_quat().reshape(frames, 9, 4).astype(np.float32)
    path = np.concatenate([0.8 * t, 0.9 + 0.05 * np.sin(4 * t), 0.3 * np.cos(t)], axis=2).astype(np.float32)
    return Motion(rotations, np.zeros((frames, 3), np.float32), fps, np.array([1], np.int32), path)
