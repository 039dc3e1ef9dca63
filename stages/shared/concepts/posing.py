"""Joint positions put back on the rig that they come from, by the least turn of each bone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.concepts.body_positions import Body
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.kinematics.rotations import continuous_signs, smallest_turn


def follow_positions(skeleton: Skeleton, motion: Motion, body: Body, targets: np.ndarray) -> Motion:
    """The motion with its body moved to positions.

    Args:
        targets: (T, J, 3) metres in the world, of `body.joints`.

    A bone turns by the least rotation that points it at its target, and keeps its length and its roll; a joint with
    several bones turns by the rotation that fits them best. Joints that are not among `body.joints` (fingers, twists)
    turn with the nearest one above them. The pelvis moves to its target.
    """
    now = positions_of(skeleton, motion)[:, body.joints]
    targets = np.asarray(targets, np.float64)
    turns: dict[int, Rotation] = {}
    rotations = motion.rotations.astype(np.float64)
    for at, joint in enumerate(body.joints.tolist()):
        below = np.flatnonzero(body.parents == at)
        above = turns.get(int(body.joints[body.parents[at]])) if at else None
        if not len(below):
            turns[joint] = above if above is not None else Rotation.identity(motion.frames)
            continue
        old, new = now[:, below] - now[:, at, None], targets[:, below] - targets[:, at, None]
        one = len(below) == 1
        turns[joint] = Rotation.from_quat(smallest_turn(old[:, 0], new[:, 0])) if one else _best_turns(old, new)
    for joint in range(skeleton.joints):
        nearest = joint
        while nearest >= 0 and nearest not in turns:
            nearest = int(skeleton.parents[nearest])
        if nearest >= 0:
            turned = turns[nearest] * Rotation.from_quat(rotations[:, joint])
            rotations[:, joint] = turned.as_quat()
    moved = targets[:, 0] - now[:, 0]
    roots, tracks = motion.root_positions.astype(np.float64), motion.tracks.astype(np.float64)
    tracked = np.flatnonzero(motion.track_joints == skeleton.root)
    if skeleton.root and len(tracked):
        parent = Rotation.from_quat(motion.rotations[:, skeleton.parents[skeleton.root]].astype(np.float64))
        tracks[:, tracked[0]] += parent.inv().apply(moved)
    else:
        roots = roots + moved
    return replace(
        motion,
        rotations=continuous_signs(rotations).astype(np.float32),
        root_positions=roots.astype(np.float32),
        tracks=tracks.astype(np.float32),
    )


def _best_turns(old: np.ndarray, new: np.ndarray) -> Rotation:
    """Rotations of least squared error from vectors (T, K, 3) to others (Kabsch)."""
    left, _, right = np.linalg.svd(new.transpose(0, 2, 1) @ old)
    signs = np.ones((len(old), 3))
    signs[:, 2] = np.sign(np.linalg.det(left @ right))
    return Rotation.from_matrix((left * signs[:, None]) @ right)
