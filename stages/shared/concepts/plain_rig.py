"""A rig for joints of which only positions are known, and positions put on it as a motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from data_schemas.concepts import StoredBody
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.concepts.body_positions import body_of, relative_poses
from stages.shared.concepts.posing import follow_positions
from stages.shared.humanoid.body_groups import find_body_parts
from stages.shared.humanoid.reference_pose import bone_tails

_LEAF_M = 0.1
_LEAST = 0.2  # a mean of unit vectors that is shorter has no clear direction


def rig_of_positions(body: StoredBody, motions: Sequence[np.ndarray]) -> Skeleton:
    """A skeleton of a body's joints: bones of the motions' mean lengths, in the mean of their directions at rest.

    Args:
        motions: of positions (T, J, 3) metres, each at least a frame. Directions are taken where poses face +Z.
    """
    poses = np.concatenate([relative_poses(np.asarray(each, np.float64), body.groups) for each in motions])
    joints = len(body.names)
    offsets = np.zeros((joints, 3))
    for joint in range(1, joints):
        bones = poses[:, joint] - poses[:, body.parents[joint]]
        lengths = np.linalg.norm(bones, axis=1)
        mean = (bones / np.maximum(lengths, 1e-9)[:, None]).mean(axis=0)
        if np.linalg.norm(mean) < _LEAST:
            mean = bones[0] if lengths[0] > 0 else np.array([0.0, 1.0, 0.0])
        offsets[joint] = lengths.mean() * mean / max(np.linalg.norm(mean), 1e-9)
    parts = find_body_parts(body.names, body.parents, offsets, np.zeros(joints))
    tails, _ = bone_tails(body.names, body.parents, offsets, np.zeros((joints, 3)), parts, _LEAF_M)
    for joint in range(joints):
        if not np.linalg.norm(tails[joint]) > 0:
            length = np.linalg.norm(offsets[joint])
            tails[joint] = offsets[joint] / length * _LEAF_M if length > 0 else np.array([0.0, _LEAF_M, 0.0])
    return Skeleton(
        names=body.names, parents=body.parents, offsets=offsets, tails=tails, groups=body.groups,
        sampled=np.ones(joints, bool), root=0,
    )  # fmt: skip


def motion_of_positions(skeleton: Skeleton, positions: np.ndarray, fps: float) -> Motion:
    """Positions (T, J, 3) in the world as a motion of a skeleton of `rig_of_positions`.

    Bones keep the rig's lengths: where those of the positions differ, joints move.
    """
    turns = np.zeros((len(positions), skeleton.joints, 4), np.float32)
    turns[..., 3] = 1
    still = Motion(turns, np.asarray(positions[:, 0], np.float32), fps)
    return follow_positions(skeleton, still, body_of(skeleton), positions)
