"""Retargeting: the motion of one humanoid on another one, of which only a reference pose is known.

First a common reference pose is found. The poses of each body are its rest pose and the frames of its file. The most
similar pair, one pose of each body, is chosen, and its remaining difference is removed bone by bone. The two rest
poses are chosen unless another pair is much more similar (REST_MARGIN_RAD), because the directions of bones do not
show how a bone is twisted. From this pose on, every bone of the target turns, in the world, as the bones of the
source that match it.

Names are not used; see `stages.shared.humanoid.bone_matching`. All rotations are global, xyzw, Y up; metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.humanoid.bone_matching import (
    ARMS,
    LEGS,
    LIMBS,
    Piece,
    bone_lengths,
    bones_of,
    carrier_of,
    match_limb,
    size_ratio,
    spine_of,
)
from stages.shared.humanoid.reference_pose import turn_to_y_up
from stages.shared.kinematics.foot_contacts import find_feet, floor_levels
from stages.shared.kinematics.forward import positions_of
from stages.shared.kinematics.rotations import continuous_signs, smallest_turn

OWN_SHAPE_RAD = np.radians(25)  # a smaller difference of clavicles, feet or hands is of build, not of pose
NARROW_M = 0.03  # shoulders nearer to each other than this do not determine how the chest is turned
CANDIDATES = 200  # poses of each body from which the reference is chosen
UPRIGHT = 0.5  # least cosine between trunk and up, and between legs and down, of a usable rest pose
REST_POSE = -1  # stands for the index of a frame
REST_MARGIN_RAD = np.radians(20)  # the rest poses may be this much farther apart than the best pair
_SAME_RIG = np.cos(np.radians(2))  # least cosine between offsets of corresponding joints of one rig
_SAME_M = 1e-4


@dataclass(frozen=True)
class Retargeted:
    """A retargeted motion.

    motion:       on the target skeleton, with the frames and rate of the source.
    size:         length of the target's legs over the source's, the factor of paths and heights.
    centre:       (3,) centre of that scaling in the source's world: on its floor, where the motion starts.
    lift_m:       how far the target was raised after that, so that its feet are as low as the source's.
    source_frame: the source's reference frame. target_frame: that of the target's file. REST_POSE for a rest pose.
    apart_rad:    mean angle between matching limb bones of the two reference poses, before it was removed.
    source_reference: (S, 4) global rotations of the source's joints in its reference pose.
    target_reference: (J, 4) those of the target's joints in the same pose, its bones turned into the source's pose.
    """

    motion: Motion
    size: float
    centre: np.ndarray
    lift_m: float
    source_frame: int
    target_frame: int
    apart_rad: float
    source_reference: np.ndarray
    target_reference: np.ndarray

    def in_targets_world(self, places: np.ndarray) -> np.ndarray:
        """Places (..., 3) of the source's world, scaled to the target's size."""
        return self.centre + self.size * (places - self.centre) + np.array([0.0, self.lift_m, 0.0])


@dataclass(frozen=True)
class _PosedBody:
    """A skeleton in F poses: positions (F, J, 3) metres, rotations (F, J, 4) global."""

    skeleton: Skeleton
    positions: np.ndarray
    rotations: np.ndarray

    def at(self, pose: int) -> _PosedBody:
        """The body in one of its poses."""
        return _PosedBody(self.skeleton, self.positions[[pose]], self.rotations[[pose]])

    def directions(self, bones: tuple[int, ...]) -> np.ndarray:
        """(F, 3) unit, from the first bone's head to the last one's tail."""
        first, last = bones[0], bones[-1]
        tails = Rotation.from_quat(self.rotations[:, last]).apply(self.skeleton.tails[last])
        return _unit(self.positions[:, last] + tails - self.positions[:, first])

    def pelvis(self) -> Rotation:
        """F rotations from body to world axes: X to the left hip, Y up the trunk, Z forward."""
        legs = [bones_of(self.skeleton, leg) for leg in LEGS]
        hips = [self.positions[:, leg[0]] for leg in legs]
        if np.median(np.linalg.norm(hips[0] - hips[1], axis=1)) < NARROW_M:  # hip bones that begin at the pelvis
            hips = [self.positions[:, leg[1 if len(leg) > 1 else 0]] for leg in legs]
        return _frames(hips[0] - hips[1], self.positions[:, carrier_of(self.skeleton)] - (hips[0] + hips[1]) / 2)

    def chest(self) -> Rotation:
        """F rotations from body to world axes: X to the left shoulder, Y to the neck, Z forward."""
        arms = [bones_of(self.skeleton, arm) for arm in ARMS]
        across = self.positions[:, arms[0][0]] - self.positions[:, arms[1][0]]
        if np.median(np.linalg.norm(across, axis=1)) < NARROW_M:  # collar bones that meet at the spine
            across = self.positions[:, arms[0][-1]] - self.positions[:, arms[1][-1]]
        carrier = carrier_of(self.skeleton)
        up = Rotation.from_quat(self.rotations[:, carrier]).apply(self.skeleton.tails[carrier])
        return _frames(across, up)

    def neck(self) -> np.ndarray:
        """(F, 3) unit, from the neck's first joint to the head's, or to the top if there is no neck."""
        above = [bone for bone in spine_of(self.skeleton).bones if bone > carrier_of(self.skeleton)]
        if not above:
            return self.directions((carrier_of(self.skeleton),))
        return self.directions(tuple(above[:-1] or above))


def _frames(left: np.ndarray, up: np.ndarray) -> Rotation:
    """Right-handed axes with Y along `up` and X as near to `left` as possible; both (F, 3)."""
    up = _unit(up)
    left = _unit(left - (left * up).sum(1, keepdims=True) * up)
    return Rotation.from_matrix(np.stack([left, up, np.cross(left, up)], axis=-1))


def retarget(source: Skeleton, motion: Motion, target: Skeleton, poses: Motion | None = None) -> Retargeted:
    """Retarget a motion to another skeleton.

    Args:
        source, motion: the skeleton and the motion to retarget.
        target: the skeleton of the result.
        poses: poses of the target that may be its reference, besides its rest pose; None for the rest pose alone.

    Raises: InputError if the target's rest pose is not a human pose and `poses` has no better one, or if a skeleton
        lacks a limb.
    """
    moving = _PosedBody(source, positions_of(source, motion), motion.rotations)
    pieces = {group: match_limb(source, target, group) for group in LIMBS}
    turns = _answers(source, target, pieces)
    if _is_same_rig(source, target):
        still, anchor, frames, apart = _at_rest(source), _at_rest(target), (REST_POSE, REST_POSE), 0.0
        reference = {joint: Rotation.from_quat(q) for joint, q in enumerate(still.rotations[0])}
    else:
        still, anchor, frames, apart = _shared_pose(moving, target, poses, pieces)
        reference = _reference_in_source_pose(still, anchor, pieces)
    rotations = _carried(moving, still, anchor, turns, reference)
    carried = _carried(still, still, anchor, turns, reference)[0] if frames[0] == REST_POSE else rotations[frames[0]]
    size = size_ratio(source, target)
    centre, hips = _path(moving)
    at_origin = Motion(rotations.astype(np.float32), np.zeros((motion.frames, 3), np.float32), motion.fps)
    roots = centre + size * (hips - centre) - _hips(target, positions_of(target, at_origin))
    made = Motion(at_origin.rotations, roots.astype(np.float32), motion.fps)
    lift = centre[1] - float(floor_levels(positions_of(target, made), find_feet(target)).min())
    made.root_positions[:, 1] += lift
    references = still.rotations[0], carried.astype(np.float32)
    return Retargeted(made, size, centre, lift, *frames, apart, *references)


def rest_pose(skeleton: Skeleton) -> Motion:
    """One frame of the skeleton at zero rotations, joint 0 at the origin.

    It is turned from the source's up axis to Y up, unless the body stands without this turn: many sources rest Y up
    and move Z up.
    """
    flat = Motion(np.zeros((1, skeleton.joints, 4), np.float32), np.zeros((1, 3), np.float32), 30.0)
    flat.rotations[..., 3] = 1.0
    turn = turn_to_y_up(skeleton.up_axis)
    if turn is None or is_human_pose(skeleton, flat):
        return flat
    flat.rotations[:] = turn.as_quat()
    return flat


def is_human_pose(skeleton: Skeleton, pose: Motion) -> bool:
    """Whether the body stands in the first frame: trunk up, legs down."""
    body = _PosedBody(skeleton, positions_of(skeleton, pose)[:1], pose.rotations[:1])
    legs = np.stack([body.directions(bones_of(skeleton, leg)[:2])[0] for leg in LEGS])
    spine = body.directions(bones_of(skeleton, 0))[0]
    return bool(spine[1] > UPRIGHT and (legs[:, 1] < -UPRIGHT).all())


def _at_rest(skeleton: Skeleton) -> _PosedBody:
    rest = rest_pose(skeleton)
    return _PosedBody(skeleton, positions_of(skeleton, rest), rest.rotations)


def _shared_pose(
    moving: _PosedBody, target: Skeleton, poses: Motion | None, pieces: dict[int, tuple[Piece, ...]]
) -> tuple[_PosedBody, _PosedBody, tuple[int, int], float]:
    """One pose of each body; the two are taken for the same pose.

    Returns: the source and the target, each in one pose; their frames, REST_POSE for a rest pose; the mean angle
        between their limbs, which is still to be removed.
    Raises: InputError if the target has no pose to start from.
    """
    models, names = _reference_poses(target, poses)
    frame, model, apart = _most_alike(moving, models, pieces)
    still, which = moving.at(frame), frame
    source = moving.skeleton
    if names[0] == REST_POSE and is_human_pose(source, rest_pose(source)):
        resting = _at_rest(source)
        _, _, rests_apart = _most_alike(resting, models.at(0), pieces)
        if rests_apart <= apart + REST_MARGIN_RAD:
            still, which, model, apart = resting, REST_POSE, 0, rests_apart
    return still, models.at(model), (which, names[model]), apart


def _is_same_rig(source: Skeleton, target: Skeleton) -> bool:
    """Whether both rest poses have the same joints in the same directions, so that any rotation means the same."""
    if not np.array_equal(source.parents, target.parents):
        return False
    one, other = source.offsets[1:], target.offsets[1:]
    sizes = [np.linalg.norm(each, axis=1) for each in (one, other)]
    tiny = [size < _SAME_M for size in sizes]
    cosines = (one * other).sum(axis=1) / np.maximum(sizes[0] * sizes[1], 1e-12)
    return bool((tiny[0] == tiny[1]).all() and (tiny[0] | (cosines > _SAME_RIG)).all())


def _reference_poses(target: Skeleton, poses: Motion | None) -> tuple[_PosedBody, list[int]]:
    """The target in every pose that may be its reference, and the frame of each; REST_POSE comes first."""
    candidates, names = [], []
    if is_human_pose(target, rest := rest_pose(target)):
        candidates.append((positions_of(target, rest), rest.rotations))
        names.append(REST_POSE)
    if poses is not None:
        chosen = np.unique(np.linspace(0, poses.frames - 1, CANDIDATES).astype(int))
        candidates.append((positions_of(target, poses)[chosen], poses.rotations[chosen]))
        names += [int(frame) for frame in chosen]
    if not candidates:
        raise InputError(
            "The rig's rest pose is not a standing human pose, and there is no other pose of it.",
            "Give a BVH of the rig with at least one frame of motion.",
        )
    positions, rotations = (np.concatenate(parts) for parts in zip(*candidates, strict=True))
    return _PosedBody(target, positions, rotations), names


def _most_alike(
    moving: _PosedBody, models: _PosedBody, pieces: dict[int, tuple[Piece, ...]]
) -> tuple[int, int, float]:
    """Frame of the source and pose of the target whose limbs are most similar, seen from their trunks."""
    chosen = np.unique(np.linspace(0, len(moving.positions) - 1, CANDIDATES).astype(int))
    some = _PosedBody(moving.skeleton, moving.positions[chosen], moving.rotations[chosen])
    lower, upper = (_between(getattr(some, part)(), getattr(models, part)()) for part in ("pelvis", "chest"))
    bend = _between(some.pelvis().inv() * some.chest(), models.pelvis().inv() * models.chest())
    angles = [_angles(upper, some.neck(), models.neck()), *2 * [bend.magnitude().reshape(len(chosen), -1)]]
    for group, limb in pieces.items():
        turn = lower if group in LEGS else upper
        angles += [_angles(turn, some.directions(p.source), models.directions(p.target)) for p in limb]
    apart = np.mean(angles, axis=0)
    frame, model = np.unravel_index(int(apart.argmin()), apart.shape)
    return int(chosen[frame]), int(model), float(apart.min())


def _between(some: Rotation, others: Rotation) -> Rotation:
    """(A * B) rotations from each of B frames of axes to each of A, the second index running fastest."""
    first, second = (each.as_quat() for each in (some, others))
    return (
        Rotation.from_quat(np.repeat(first, len(second), 0))
        * Rotation.from_quat(np.tile(second, (len(first), 1))).inv()
    )


def _angles(turns: Rotation, some: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(A, B) angles between directions (A, 3) and (B, 3), after the rotations that `_between` returns."""
    shape = (len(some), len(others))
    turned = turns.apply(np.tile(others, (len(some), 1))).reshape(*shape, 3)
    return np.arccos(np.clip((turned * some[:, None]).sum(-1), -1, 1))


def _answers(source: Skeleton, target: Skeleton, pieces: dict[int, tuple[Piece, ...]]) -> dict[int, np.ndarray]:
    """For every bone of the target with a match: (S,) weights of the source's bones, whose rotations it takes."""
    answers: dict[int, np.ndarray] = {}
    for piece in (piece for group in pieces.values() for piece in group):
        # Of several bones that match one, the longest gives the rotation: a thigh's, not those of the hip's motors.
        longest = piece.source[int(bone_lengths(source, piece.source).argmax())]
        answers |= {bone: _one_hot(source.joints, longest) for bone in piece.target}
    theirs, ours = spine_of(source), spine_of(target)
    for bone, place in zip(ours.bones, ours.places, strict=True):
        after = int(np.searchsorted(theirs.places, place).clip(1, max(len(theirs.places) - 1, 1)))
        if len(theirs.bones) == 1:
            answers[bone] = _one_hot(source.joints, theirs.bones[0])
            continue
        low, high = theirs.places[after - 1], theirs.places[after]
        share = float(np.clip((place - low) / max(high - low, 1e-9), 0, 1))
        answers[bone] = (1 - share) * _one_hot(source.joints, theirs.bones[after - 1])
        answers[bone] += share * _one_hot(source.joints, theirs.bones[after])
    return answers


def _one_hot(count: int, index: int) -> np.ndarray:
    row = np.zeros(count)
    row[index] = 1.0
    return row


def _carried(
    moving: _PosedBody,
    still: _PosedBody,
    anchor: _PosedBody,
    answers: dict[int, np.ndarray],
    reference: dict[int, Rotation],
) -> np.ndarray:
    """(T, J, 4) global rotations of the target: its reference pose, turned as the source turns from its own."""
    target = anchor.skeleton
    now, then = Rotation.from_quat, Rotation.from_quat(still.rotations[0])
    frames = len(moving.rotations)
    out = np.empty((frames, target.joints, 4))
    turns = {
        bone: now(moving.rotations[:, bone]) * then[bone].inv()
        for bone in {int(b) for weights in answers.values() for b in np.flatnonzero(weights)}
    }
    for joint in range(target.joints):
        parent = int(target.parents[joint])
        if joint in answers:
            turn = _blended(turns, answers[joint])
            out[:, joint] = (turn * reference[joint]).as_quat()
        elif parent < 0 or target.groups[joint] < 0:
            out[:, joint] = anchor.rotations[0, joint]  # above or beside the body: unchanged
        else:  # no match: it keeps its place on its parent
            own = Rotation.from_quat(anchor.rotations[0, parent]).inv() * Rotation.from_quat(
                anchor.rotations[0, joint]
            )
            out[:, joint] = (now(out[:, parent]) * own).as_quat()
    return continuous_signs(out)


def _blended(turns: dict[int, Rotation], weights: np.ndarray) -> Rotation:
    bones = np.flatnonzero(weights)
    if len(bones) == 1:
        return turns[int(bones[0])]
    return _part_way(turns[int(bones[0])], turns[int(bones[1])], float(weights[bones[1]]))


def _reference_in_source_pose(
    still: _PosedBody, anchor: _PosedBody, pieces: dict[int, tuple[Piece, ...]]
) -> dict[int, Rotation]:
    """Global rotations of the target's joints with its body turned, bone by bone, into the source's pose."""
    lower, upper = (getattr(still, part)()[0] * getattr(anchor, part)()[0].inv() for part in ("pelvis", "chest"))
    made = {joint: lower * Rotation.from_quat(q) for joint, q in enumerate(anchor.rotations[0])}
    spine = spine_of(anchor.skeleton)
    neck = Rotation.from_quat(smallest_turn(upper.apply(anchor.neck()[0]), still.neck()[0]))
    for bone, place in zip(spine.bones, spine.places, strict=True):
        turn = _part_way(lower, upper, min(float(place), 1.0))
        made[bone] = (neck * upper if place > 1 else turn) * Rotation.from_quat(anchor.rotations[0, bone])
    for group, limb in pieces.items():
        lengths = [bone_lengths(anchor.skeleton, piece.target).sum() for piece in limb]
        whole = lower if group in LEGS else upper
        for piece, length in zip(limb, lengths, strict=True):
            way = whole.apply(anchor.directions(piece.target)[0])
            turn = Rotation.from_quat(smallest_turn(way, still.directions(piece.source)[0]))
            if length < 0.6 * max(lengths) and turn.magnitude() < OWN_SHAPE_RAD:
                turn = Rotation.identity()  # no upper arm, forearm, thigh or shin: its build, not its pose
            for bone in piece.target:
                made[bone] = turn * whole * Rotation.from_quat(anchor.rotations[0, bone])
    return made


def _part_way(first: Rotation, second: Rotation, share: float) -> Rotation:
    return first * Rotation.from_rotvec(share * (first.inv() * second).as_rotvec())


def _path(moving: _PosedBody) -> tuple[np.ndarray, np.ndarray]:
    """The point on the floor under the first frame's hips (3,), and where the hips go (T, 3)."""
    hips = _hips(moving.skeleton, moving.positions)
    floor = float(floor_levels(moving.positions, find_feet(moving.skeleton)).min())
    return np.array([hips[0, 0], floor, hips[0, 2]]), hips


def _hips(skeleton: Skeleton, positions: np.ndarray) -> np.ndarray:
    """(T, 3) the middle between the hip joints."""
    return positions[:, [bones_of(skeleton, leg)[0] for leg in LEGS]].mean(axis=1)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
