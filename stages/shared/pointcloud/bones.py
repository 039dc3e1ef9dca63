"""The bones of a point cloud: a skeleton's body without bones that carry no points."""

from __future__ import annotations

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import Skeleton
from data_schemas.tpc import BoneSet
from stages.shared.pointcloud.sampling import draw_points


def body_joints(skeleton: Skeleton) -> np.ndarray:
    """Joints of the body that carry points or have such joints below them, pelvis first, parents before children.

    Fingers, faces and props are removed; a zero-length joint inside the body stays, since it turns the joints below
    it.
    """
    needed = np.asarray(skeleton.sampled, bool) & (skeleton.groups >= 0)
    for joint in range(skeleton.joints - 1, 0, -1):
        needed[skeleton.parents[joint]] |= needed[joint]
    needed &= skeleton.groups >= 0
    needed[skeleton.root] = True
    return np.flatnonzero(needed)


def bone_set(skeleton: Skeleton, points: int, seed: int) -> tuple[BoneSet, np.ndarray]:
    """The bone set of a skeleton, with drawn points, and the (B,) joints of its bones.

    Weights are the bones' lengths, normalised (PC-MRL 3.1: a bone is drawn in proportion to its length).
    Raises: InputError if no bone carries points.
    """
    joints = body_joints(skeleton)
    lengths = np.linalg.norm(skeleton.tails[joints], axis=1)
    weights = np.where(skeleton.sampled[joints], lengths, 0.0)
    if not weights.sum() > 0:
        raise InputError("A skeleton has no bone that points could be drawn on.")
    weights /= weights.sum()
    place = {int(joint): index for index, joint in enumerate(joints)}
    parents = [place.get(int(skeleton.parents[joint]), -1) for joint in joints]
    bones, alphas, offsets = draw_points(weights, points, np.random.default_rng(seed))
    return (
        BoneSet(
            parents=np.array(parents, np.int32),
            tails=skeleton.tails[joints].astype(np.float32),
            groups=skeleton.groups[joints].astype(np.int8),
            weights=weights.astype(np.float32),
            point_bones=bones,
            point_alphas=alphas,
            point_offsets=offsets,
        ),
        joints,
    )
