"""A motion seen in a mirror, on its own skeleton: left and right exchanged.

In a mirror M of the world (a reflection through a plane), a joint's frame becomes left-handed, so it cannot be the
frame of any joint. But the frames of a pair of joints correspond by a reflection too: S_j takes what is seen from the
frame of j's partner j' to what is seen from the frame of j. With both,

    G'_j = M G_j' S_j^T,        root' = M root,        track'_j = S_parent(j) track_j'

is a motion of the same skeleton. S_j is read off poses in which the body is symmetric, with M_0 the mirror between
its left and right: S_j = G_j^T M_0 G_j'
(the mean over the poses). Then S_j S_j' = 1, whatever the pose is, so that a motion mirrored twice is
itself. In most rigs the frames' axes correspond to each other up to their signs; S_j is then made exactly that.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from scipy.spatial.transform import Rotation

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.humanoid.anatomy import parts_of_skeleton
from stages.shared.humanoid.body_groups import BodyParts
from stages.shared.humanoid.facing import BodyPoses, bone_tips, find_facing
from stages.shared.humanoid.retargeting import is_human_pose, rest_pose
from stages.shared.humanoid.symmetric_pairs import find_pairs
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.kinematics.rotations import continuous_signs, multiply

_CANDIDATES = 200
_SHARE = 0.3  # of them: the most symmetric ones
_LOPSIDED = 0.05  # mean distance from symmetry, of the body's height: a rest pose beyond is not used
_NEAR_AXIS = np.cos(np.radians(15))
_NEAR_REST, _NEAR_FRAMES = np.radians(25), np.radians(60)  # from the reflection found to one along the axes
_SAME_DIRECTION = np.cos(np.radians(15))
_OFF_CENTRE_M, _TINY_M = 1e-3, 1e-3
REFLECTIONS = np.array(
    [
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
        if np.linalg.det(np.eye(3)[list(order)] * np.array(signs)[:, None]) < 0
    ]
)  # (24, 3, 3): all left-handed matrices that exchange axes and change their signs


@dataclass(frozen=True)
class Mirror:
    """The mirror of a skeleton.

    world:   (3, 3) the reflection M of the world (Y up).
    partner: (J,) each joint's one on the other side, or itself.
    frames:  (J, 3, 3) the reflections S_j.
    """

    world: np.ndarray
    partner: np.ndarray
    frames: np.ndarray


def mirror_of(skeleton: Skeleton, motion: Motion, across: str = "auto") -> Mirror:
    """The mirror of a skeleton, whose symmetric pose is its rest pose or the most symmetric frame of the motion.

    Args:
        across: "x" or "z", the axis along which the world is reflected; "auto" for the one from the body's left to
            its right at rest, or x where that is none.

    Raises: InputError if the skeleton has no pair of joints on its two sides.
    """
    pairs = find_pairs(skeleton.names, skeleton.parents, skeleton.offsets, skeleton.groups)
    if not pairs:
        raise InputError(
            "No joint of this rig was found to have a partner on the other side.",
            "Name left and right with --skeleton-map (`pumps inspect FILE --map` prints one to edit).",
        )
    partner = np.arange(skeleton.joints)
    for left, right in pairs:
        partner[left], partner[right] = right, left
    rotations, planes, at_rest = _symmetric_poses(skeleton, motion, partner)
    frames = np.empty((skeleton.joints, 3, 3))
    for joint in range(skeleton.joints):
        other = int(partner[joint])
        if other < joint:
            frames[joint] = frames[other].T
            continue
        found = _nearest_reflection(
            (rotations[:, joint].transpose(0, 2, 1) @ planes @ rotations[:, other]).mean(axis=0)
        )
        above = frames[skeleton.parents[joint]] if joint else found
        frames[joint] = _along_axes(skeleton, partner, joint, found, above, _NEAR_REST if at_rest else _NEAR_FRAMES)
    across_z = across == "z" or (across == "auto" and at_rest and planes[0, 2, 2] == -1)
    flip = (1.0, 1.0, -1.0) if across_z else (-1.0, 1.0, 1.0)
    world = np.diag(flip)
    return Mirror(world, partner, frames)


def mirrored(skeleton: Skeleton, motion: Motion, mirror: Mirror) -> Motion:
    """The motion in the mirror, on the same skeleton, sign-continuous."""
    flip = np.diag(mirror.world)
    # M G M turns the same way about the axis across the mirror, and the other way about the two axes in it.
    seen = motion.rotations[:, mirror.partner].astype(np.float64) * np.array([*-flip, 1.0])
    onward = Rotation.from_matrix(mirror.world @ mirror.frames.transpose(0, 2, 1)).as_quat()
    turned = np.abs(onward[:, 3]) < 1 - 1e-12
    seen[:, turned] = multiply(seen[:, turned], onward[turned])
    rotations = continuous_signs(seen).astype(np.float32)
    tracks = {int(joint): motion.tracks[:, at].astype(np.float64) for at, joint in enumerate(motion.track_joints)}
    joints = sorted({*tracks, *(int(mirror.partner[joint]) for joint in tracks)})
    made = np.zeros((motion.frames, len(joints), 3), np.float32)
    for at, joint in enumerate(joints):
        other = int(mirror.partner[joint])
        track = tracks.get(other, np.broadcast_to(skeleton.offsets[other], (motion.frames, 3)))
        made[:, at] = track @ mirror.frames[int(skeleton.parents[joint])].T
    roots = motion.root_positions * flip.astype(np.float32)
    result = Motion(rotations, roots, motion.fps, np.array(joints, np.int32), made)
    if skeleton.root == 0:
        return result
    wanted = positions_of(skeleton, motion)[:, skeleton.root] * flip
    away = wanted - positions_of(skeleton, result)[:, skeleton.root]
    if np.abs(away).max() > _OFF_CENTRE_M:
        result.root_positions[:] += away.astype(np.float32)
    return result


def _symmetric_poses(skeleton: Skeleton, motion: Motion, partner: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool]:
    """Poses in which the body is symmetric: global rotations (F, J, 3, 3), the reflections (F, 3, 3) between the
    sides, and whether they are the rest pose alone."""
    parts, _, _ = parts_of_skeleton(skeleton)
    try:
        rest = rest_pose(skeleton)
        if is_human_pose(skeleton, rest):
            left, off = _asymmetry(skeleton, rest, parts, partner)
            if off[0] < _LOPSIDED:
                axis = int(np.abs(left[0]).argmax())
                normal = np.eye(3)[axis] if np.abs(left[0, axis]) > _NEAR_AXIS else left[0]
                return _matrices_of(rest.rotations), _reflections(normal[None]), True
    except InputError:
        pass  # a limb is missing, and the rest pose cannot be judged
    some = motion.at(np.unique(np.linspace(0, motion.frames - 1, _CANDIDATES).astype(int)))
    left, off = _asymmetry(skeleton, some, parts, partner)
    best = np.argsort(off)[: max(round(_SHARE * len(off)), 1)]
    return _matrices_of(some.rotations[best]), _reflections(left[best]), False


def _asymmetry(
    skeleton: Skeleton, motion: Motion, parts: BodyParts, partner: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Of F poses: left (F, 3) unit, and how far the body's joints are from where their partners' images are (F,), on
    average and as a share of the body's height."""
    heads = positions_of(skeleton, motion)
    known = np.linalg.norm(skeleton.tails, axis=1) > 0
    poses = BodyPoses(heads, bone_tips(heads, motion.rotations.astype(float), skeleton.tails, known))
    left = find_facing(poses, parts).left
    body = skeleton.groups >= 0
    centred = heads - heads[:, skeleton.root : skeleton.root + 1]
    images = centred - 2 * (centred * left[:, None]).sum(-1, keepdims=True) * left[:, None]
    off = np.linalg.norm(images[:, partner] - centred, axis=-1)[:, body].mean(axis=1)
    height = np.ptp(heads[:, body, 1], axis=1).max()
    return left, off / max(float(height), 1e-9)


def _matrices_of(rotations: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4) as matrices (..., 3, 3), float64."""
    flat = Rotation.from_quat(rotations.reshape(-1, 4).astype(np.float64)).as_matrix()
    return flat.reshape(*rotations.shape[:-1], 3, 3)


def _reflections(normals: np.ndarray) -> np.ndarray:
    """(F, 3, 3) reflections through planes with unit normals (F, 3)."""
    return np.eye(3) - 2 * normals[:, :, None] * normals[:, None, :]


def _nearest_reflection(matrix: np.ndarray) -> np.ndarray:
    """The left-handed orthogonal matrix nearest to a matrix (3, 3)."""
    left, _, right = np.linalg.svd(matrix)
    left[:, 2] *= -np.linalg.det(left @ right)
    return left @ right


def _along_axes(
    skeleton: Skeleton, partner: np.ndarray, joint: int, found: np.ndarray, above: np.ndarray, near: float
) -> np.ndarray:
    """The parent's reflection, or else the reflection along the axes that is nearest to the one found, if it is near
    and the ends of the joint's bones lie as their partners do in it; otherwise the one found."""
    other = int(partner[joint])
    choices = REFLECTIONS
    if other == joint:
        choices = choices[np.abs(choices - choices.transpose(0, 2, 1)).max(axis=(1, 2)) == 0]
    ends = [(skeleton.tails[joint], skeleton.tails[other])] if skeleton.sampled[joint] else []
    children = [int(child) for child in np.flatnonzero(skeleton.parents == joint)]
    twins = [(child, int(partner[child])) for child in children if skeleton.parents[partner[child]] == other]
    for here, there in [*ends, *((skeleton.offsets[child], skeleton.offsets[twin]) for child, twin in twins)]:
        size = float(np.linalg.norm(here) * np.linalg.norm(there))
        if size > _TINY_M**2:
            choices = choices[(choices @ there) @ here > _SAME_DIRECTION * size]
    if len(choices) == 0:
        return found
    away = np.arccos(np.clip((np.einsum("nij,ij->n", choices, found) - 1) / 2, -1, 1))
    alike = (choices == above).all(axis=(1, 2))
    if alike.any() and (away[alike].min() < near or away.min() >= near):  # a limb that moves alone shows little
        return above
    return choices[int(away.argmin())] if away.min() < near else found
