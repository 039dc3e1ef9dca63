"""Joint positions put back on the rig that they come from, by the least turn of each bone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.concepts.body_positions import Body
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.kinematics.rotations import continuous_signs, smallest_turn

_NO_LENGTH_M = 0.005  # a bone shorter than this points nowhere
_TOWARDS_NONE = 1e-4  # how much no turn is preferred, as a share of the vectors' squared lengths


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
    apart = _lengths(now, body)
    for at, joint in enumerate(body.joints.tolist()):
        below = _pointed_at(at, body.parents, apart)
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


def _lengths(places: np.ndarray, body: Body) -> np.ndarray:
    """(J,) longest distance of a joint from its parent, metres, on a body of `STATURE_M`."""
    return body.scale * np.linalg.norm(places - places[:, np.maximum(body.parents, 0)], axis=-1).max(0, initial=0)


def _pointed_at(at: int, parents: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """The joints to which a joint's bones lead. A joint that lies on its parent, as the hips of ASF files do, gives
    no direction: those below it are taken in its place."""
    found: list[int] = []
    for child in np.flatnonzero(parents == at).tolist():
        found += [child] if lengths[child] > _NO_LENGTH_M else _pointed_at(child, parents, lengths).tolist()
    return np.array(found, int)


def _best_turns(old: np.ndarray, new: np.ndarray) -> Rotation:
    """Rotations of least squared error from vectors (T, K, 3) to others (Kabsch); where several are as good, as
    around vectors on one line, the smallest of them."""
    both = new.transpose(0, 2, 1) @ old
    size = np.square(old).sum((-1, -2))
    left, _, right = np.linalg.svd(both + _TOWARDS_NONE * size[:, None, None] * np.eye(3))
    signs = np.ones((len(old), 3))
    signs[:, 2] = np.sign(np.linalg.det(left @ right))
    return Rotation.from_matrix((left * signs[:, None]) @ right)
