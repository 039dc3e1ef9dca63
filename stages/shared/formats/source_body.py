"""From the joints and poses that any reader returns to a Skeleton and a Motion, Y up, metres.

Readers return joints, local rotations and places in the source's own unit and axes. Found here: body parts, unit, up
axis, left and right, bones' tails, and how many frames to trim at the start.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from data_schemas.errors import InputError
from data_schemas.notes import Flag, Note, note
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.skeleton_map import SkeletonMap, choose_map, parts_of_map
from stages.shared.humanoid import reference_pose
from stages.shared.humanoid.body_groups import BodyParts, find_body_parts
from stages.shared.humanoid.facing import BodyPoses, bone_tips, find_sides, stands_on_four_feet
from stages.shared.humanoid.joint_names import has_a_tail
from stages.shared.kinematics.forward_numpy import BLOCK_FRAMES, global_rotations, joint_positions
from stages.shared.kinematics.rotations import continuous_signs, multiply

_GUIDE_FRAMES = 16
_TRIM_LOOKAHEAD = 32
_SIDES_SPACING_S = 0.2
_SIDES_FRAMES = 300
_CLEAR_BALANCE = 0.25
_JUMP_M = 0.25  # between two frames; no joint of a person moves so far

_Place = tuple[float, float, float]


@dataclass(frozen=True)
class SourceRig:
    """The joints of a source, in its own unit and axes. Tuples, so that results are cached for all files of one rig.

    names, parents: J joints, parents before children, -1 for joint 0.
    offsets:   J heads in the parents' frames at rest.
    end_sites: J ends of leaves in the joints' own frames; zeros where the source has none.
    placed:    J flags, True if the source gives the joint's place in every frame.
    unit_m:    metres in one unit if the format states it, None to find it from the stature.
    up_axis:   "y" or "z" if the format states it, None to find it from the pose.
    maps:      the user's skeleton maps; the one that matches these joints overrides what is found.
    usual_unit_m: metres in the unit of the format's standard, used unless the body is far too small or large.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: tuple[_Place, ...]
    end_sites: tuple[_Place, ...]
    placed: tuple[bool, ...]
    unit_m: float | None = None
    up_axis: str | None = None
    maps: tuple[SkeletonMap, ...] = ()
    usual_unit_m: float | None = None


class Rotations(Protocol):
    """Rotations (T, J, 4) of which frames are asked for: `rotations[frames]`, with a slice or an index array."""

    shape: tuple[int, ...]

    def __len__(self) -> int: ...
    def __getitem__(self, frames: slice | np.ndarray, /) -> np.ndarray: ...


@dataclass(frozen=True)
class SourcePoses:
    """T poses of a rig, in its unit and axes.

    local: (T, J, 4) xyzw rotations in the parents' frames, float64 or float32;
        an array, or an object that computes the frames asked for (`Rotations`).
    root: (T, 3) joint 0 in the world.
    moving: joints below joint 0 whose place in the parent's frame varies; tracks: (T, K, 3) of them.
    """

    local: np.ndarray | Rotations
    root: np.ndarray
    fps: float
    moving: Sequence[int] = ()
    tracks: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 3)))


@dataclass(frozen=True)
class SourceBody:
    """The body found on a rig, in the source's unit and axes.

    offsets: (J, 3) heads in the parents' frames, joint 0 zeros; rest: (J, 3) joints at zero rotations.
    tail_known: (J,) bool, False if a tail is a guess, since the joint has neither a child nor an End Site.
    mapped: True if the parts come from a skeleton map of the user's.
    """

    names: tuple[str, ...]
    parents: np.ndarray
    offsets: np.ndarray
    rest: np.ndarray
    tails: np.ndarray
    tail_known: np.ndarray
    on_chain: np.ndarray
    parts: BodyParts
    unit_m: float
    unit_note: Note | None
    up_axis: str | None = None
    mapped: bool = False


@lru_cache(maxsize=64)
def body_of(rig: SourceRig) -> SourceBody:
    """The body of a rig. Raises InputError if it is not a humanoid, or a skeleton map does not match it."""
    given = choose_map(rig.maps, rig.names)
    parents = np.array(rig.parents, np.int32)
    offsets = np.array(rig.offsets, np.float64)
    end_sites = np.array(rig.end_sites, np.float64)
    if given is not None:
        parts = parts_of_map(given, rig.names, parents)
    else:
        parts = find_body_parts(rig.names, parents, offsets, np.linalg.norm(end_sites, axis=1))
    offsets[0] = 0.0
    # The pelvis and the joints above it place the body in the world; their positions are not part of the skeleton.
    for joint in (parts.pelvis, *ancestors(parents, parts.pelvis)):
        if rig.placed[joint]:
            offsets[joint] = 0.0
    unit_m, unit_note = (given and given.unit_m) or rig.unit_m, None
    if unit_m is None:
        unit_m, unit_note = reference_pose.find_unit(reference_pose.stature_of(offsets, parts), rig.usual_unit_m)
    leaf = reference_pose.LEAF_LENGTH_M / unit_m
    tails, on_chain = reference_pose.bone_tails(rig.names, parents, offsets, end_sites, parts, leaf)
    known, _ = reference_pose.bone_tails(rig.names, parents, offsets, end_sites, parts, 0.0)
    tail_known = np.linalg.norm(known, axis=1) > 0
    rest = np.zeros_like(offsets)
    for joint in range(1, len(parents)):
        rest[joint] = rest[parents[joint]] + offsets[joint]
    up_axis = (given and given.up_axis) or rig.up_axis
    return SourceBody(
        rig.names,
        parents,
        offsets,
        rest,
        tails,
        tail_known,
        on_chain,
        parts,
        unit_m,
        unit_note,
        up_axis,
        given is not None,
    )


def ancestors(parents: np.ndarray, joint: int) -> list[int]:
    """The joints above a joint, from its parent up to joint 0."""
    above = []
    while parents[joint] >= 0:
        joint = int(parents[joint])
        above.append(joint)
    return above


def motion_of_poses(
    body: SourceBody,
    poses: SourcePoses,
    *,
    header: str = "",
    up_axis: str | None = None,
    rest_frame: int | None = None,
    trim_first: str | int = 0,
) -> tuple[Skeleton, Motion, list[Note]]:
    """The skeleton and the motion of a body, Y up, metres.

    Args:
        header: kept in the skeleton, for writing the file back.
        up_axis: the source's, used if `body` has none; None to find it from the pose.
        rest_frame: a frame in which the body stands upright, from which up axis and sides are found.
        trim_first: frames to drop at the start, or "auto": those of a calibration pose far from what follows.
    Returns: skeleton, motion (global float32 rotations), notes on the source's oddities.
    Raises: InputError if an argument is out of range.
    """
    notes: list[Note] = []
    frames = len(poses.local)
    if rest_frame is not None and not 0 <= rest_frame < frames:
        raise InputError(f"Rest frame {rest_frame} is outside of its frames 0 to {frames - 1}.")
    # Global rotations of a short clip are computed once; those of a long one in blocks, which limits the memory.
    whole = global_rotations(poses.local[:], body.parents) if frames <= BLOCK_FRAMES else None

    def rotations_at(index: np.ndarray) -> np.ndarray:
        return global_rotations(poses.local[index], body.parents) if whole is None else whole[index]

    guides = _guide_frames(frames) if rest_frame is None else np.array([rest_frame])
    opening = np.arange(min(_TRIM_LOOKAHEAD, frames))
    looked_at = np.concatenate([opening, guides])
    world = joint_positions(
        rotations_at(looked_at), poses.root[looked_at], body.offsets, body.parents,
        poses.moving, poses.tracks[looked_at] if len(poses.moving) else None,
    )  # fmt: skip
    world, opening_world = world[len(opening) :], world[: len(opening)] * body.unit_m
    parts = body.parts
    up_axis = body.up_axis or up_axis or reference_pose.find_up_axis(body.rest, world, parts)
    turn = reference_pose.turn_to_y_up(up_axis)
    doubtful = not parts.sided or (has_a_tail(body.names) and not body.mapped)
    if doubtful and stands_on_four_feet(world, body.rest, parts):
        raise InputError(
            "The skeleton is not a humanoid that can be recognised: it stands on four legs.",
            "If it is a humanoid, name the joints of its limbs with --skeleton-map.",
        )
    if not parts.sided:
        parts, facing = find_sides(_body_poses(body, poses, rotations_at, rest_frame), parts)
        notes.append(note(Flag.SIDES_FROM_POSE, clear=bool(abs(facing.balance) > _CLEAR_BALANCE)))
    if body.unit_note:
        notes.append(body.unit_note)
    skeleton = _skeleton(header, body, parts, up_axis)
    roots = poses.root * body.unit_m
    if turn is not None:
        roots = turn.apply(roots)
    tracks = poses.tracks * body.unit_m if len(poses.moving) else np.zeros((frames, 0, 3))
    motion = Motion(
        rotations=_upright(poses.local, body.parents, turn, whole),
        root_positions=roots.astype(np.float32),
        fps=poses.fps,
        track_joints=np.array(poses.moving, np.int32),
        tracks=tracks.astype(np.float32),
    )
    drop = _frames_to_trim(motion.frames, opening_world[:, skeleton.sampled], trim_first)
    if drop:
        notes.append(note(Flag.TRIMMED, frames=drop, calibration=str(trim_first) == "auto"))
        motion = motion.at(slice(drop, None))
    return skeleton, motion, notes


def _upright(
    local: np.ndarray | Rotations, parents: np.ndarray, turn: Rotation | None, whole: np.ndarray | None
) -> np.ndarray:
    """(T, J, 4) float32 global rotations, turned to Y up, sign-continuous; `whole`: they, if computed already."""
    out = np.empty(local.shape, np.float32)
    for start in range(0, len(local), BLOCK_FRAMES):
        block = slice(start, start + BLOCK_FRAMES)
        turns = global_rotations(local[block], parents) if whole is None else whole[block]
        if turn is not None:
            turns = multiply(turn.as_quat(), turns)
        before = out[start - 1 : start] if start else turns[:0]
        out[block] = continuous_signs(np.concatenate([before, turns]))[len(before) :]
    return out


def _body_poses(
    body: SourceBody, poses: SourcePoses, rotations_at: Callable[[np.ndarray], np.ndarray], rest_frame: int | None
) -> BodyPoses:
    """Joints and bone ends in up to a few hundred frames, a fraction of a second apart, to find left and right."""
    frames = len(poses.local)
    step = max(1, round(_SIDES_SPACING_S * poses.fps), -(-frames // _SIDES_FRAMES))
    # The first frame may be a calibration pose.
    seen = np.arange(min(1, frames - 1), frames, step) if rest_frame is None else np.array([rest_frame])
    tracks = poses.tracks[seen] if len(poses.moving) else None
    rotations = rotations_at(seen)
    heads = joint_positions(rotations, poses.root[seen], body.offsets, body.parents, poses.moving, tracks)
    return BodyPoses(heads, bone_tips(heads, rotations, body.tails, body.tail_known), step / poses.fps)


def _skeleton(header: str, body: SourceBody, parts: BodyParts, up_axis: str) -> Skeleton:
    tails = body.tails * body.unit_m
    visible = body.on_chain & (np.linalg.norm(tails, axis=1) > reference_pose.SHORTEST_BONE_M)
    return Skeleton(
        names=body.names,
        parents=body.parents,
        offsets=body.offsets * body.unit_m,
        tails=tails,
        groups=parts.groups.astype(np.int8),
        sampled=visible & (parts.groups >= 0),
        root=parts.pelvis,
        unit_m=body.unit_m,
        up_axis=up_axis,
        header=header,
    )


def _guide_frames(frames: int) -> np.ndarray:
    """A few frames over the whole clip, without frame 0 if there are others: it may be a calibration pose."""
    return np.unique(np.linspace(min(1, frames - 1), frames - 1, _GUIDE_FRAMES).astype(int))


def _frames_to_trim(frames: int, opening: np.ndarray, trim_first: str | int) -> int:
    """How many frames to drop; `opening`: (F, J, 3) metres, the sampled joints in the first frames."""
    if str(trim_first) != "auto":
        try:
            count = int(trim_first)
        except ValueError:
            raise InputError(f"The frames to trim must be a number or auto, not '{trim_first}'.") from None
        if not 0 <= count < frames:
            raise InputError(f"Cannot trim {count} of its {frames} frames.")
        return count
    steps = np.linalg.norm(np.diff(opening, axis=0), axis=-1).max(axis=1)
    if len(steps) < 8 or steps[0] < _JUMP_M or steps[0] < 2 * steps[1:8].max():
        return 0
    # Many recordings were filtered over such a jump: for a few frames the limbs still move out of the pose.
    usual = float(np.median(steps[8:])) if len(steps) > 8 else 0.0
    count = 1
    while count < 8 and usual and steps[count] > 3 * usual and steps[count] > 0.02:
        count += 1
    return count
