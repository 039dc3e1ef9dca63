"""Forward kinematics and its inverse in NumPy and float64 (PC-MRL eq. 1), for the readers and writers of files.

`stages.shared.kinematics.forward` does the same for torch tensors, in their own dtype. Both are needed: the readers
start without loading torch, and their float64 results differ from torch's float32 by rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.kinematics.rotations import CONJUGATE, continuous_signs, multiply, multiply_parts, rotate_parts

BLOCK_FRAMES = 1024  # computed at a time: their arrays fit into a processor's cache


def global_rotations(local: np.ndarray, parents: np.ndarray) -> np.ndarray:
    """Rotations in the parents' frames (T, J, 4) to global ones (T, J, 4) float64, depth by depth."""
    parts = local.astype(np.float64, copy=False).transpose(2, 1, 0)
    out = parts.copy()
    for level in _levels(np.asarray(parents, np.int32).tobytes()):
        out[:, level] = multiply_parts(out[:, parents[level]], parts[:, level])
    return out.transpose(2, 1, 0)


def local_rotations(rotations: np.ndarray, parents: np.ndarray) -> np.ndarray:
    """Global rotations (T, J, 4) to unit rotations in the parents' frames (T, J, 4) float64; joint 0's are
    unchanged."""
    rotations = rotations.astype(np.float64)
    local = rotations.copy()
    local[:, 1:] = multiply(rotations[:, parents[1:]] * CONJUGATE, rotations[:, 1:])
    return local / np.linalg.norm(local, axis=-1, keepdims=True)


def joint_positions(
    rotations: np.ndarray,
    root: np.ndarray,
    offsets: np.ndarray,
    parents: np.ndarray,
    moving: Sequence[int] = (),
    tracks: np.ndarray | None = None,
) -> np.ndarray:
    """Heads of all joints in the world, by p_n = p_m + R_m H_n (PC-MRL eq. 1).

    Args:
        rotations: (T, J, 4) global, xyzw, float32 or float64. root: (T, 3) or (3,), joint 0 in the world.
        offsets: (J, 3) heads in the parents' frames. parents: (J,), parents before children.
        moving: joints whose head in the parent's frame varies; tracks: (T, K, 3) of them.

    Returns: (T, J, 3) float64 in the offsets' unit and axes.
    """
    frames, joints = len(rotations), len(parents)
    levels = _levels(np.asarray(parents, np.int32).tobytes())
    root = np.broadcast_to(root, (frames, 3))
    out = np.empty((frames, joints, 3))
    for start in range(0, frames, BLOCK_FRAMES):
        block = slice(start, start + BLOCK_FRAMES)
        turns = np.array(rotations[block].transpose(2, 1, 0), np.float64, order="C")  # components first, time last
        count = turns.shape[2]
        steps = np.broadcast_to(offsets.T[..., None], (3, joints, count))
        if len(moving):
            steps = steps.copy()
            steps[:, list(moving)] = np.asarray(tracks)[block].transpose(2, 1, 0)
        heads = np.empty((3, joints, count))
        heads[:, 0] = root[block].T
        for level in levels:
            above = parents[level]
            for axis, moved in enumerate(rotate_parts(turns[:, above], steps[:, level])):
                heads[axis, level] = heads[axis, above] + moved
        out[block] = heads.transpose(2, 1, 0)
    return out


def positions_of(skeleton: Skeleton, motion: Motion) -> np.ndarray:
    """(T, J, 3) float64 joint heads of a motion, metres, in the world."""
    return joint_positions(
        motion.rotations, motion.root_positions, skeleton.offsets, skeleton.parents,
        motion.track_joints.tolist(), motion.tracks,
    )  # fmt: skip


def local_rotations_of(skeleton: Skeleton, motion: Motion) -> np.ndarray:
    """(T, J, 4) float64 unit rotations of a motion in the parents' frames, sign-continuous in time."""
    return continuous_signs(local_rotations(motion.rotations, skeleton.parents))


@lru_cache(maxsize=64)
def _levels(parents_bytes: bytes) -> list[np.ndarray]:
    """Joints below joint 0 by their depth, parents before children; `parents_bytes` are int32."""
    parents = np.frombuffer(parents_bytes, np.int32)
    depth = np.zeros(len(parents), int)
    for joint in range(1, len(parents)):
        depth[joint] = depth[parents[joint]] + 1
    return [np.flatnonzero(depth == d) for d in range(1, int(depth.max()) + 1)]


def pelvis_and_above(parents: np.ndarray, pelvis: int) -> np.ndarray:
    """(J,) bool: the joints that turn the whole body, of a tree with parents (J,)."""
    found = np.zeros(len(parents), bool)
    joint = pelvis
    while joint >= 0:
        found[joint] = True
        joint = int(parents[joint])
    return found
