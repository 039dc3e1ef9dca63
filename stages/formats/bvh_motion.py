"""A BVH's rows to a Skeleton and a Motion, and back to rows in the file's own unit, axes and channel orders.

Position channels replace a joint's OFFSET, as every exporter of such files means it. A joint below joint 0 whose
position varies gets a translation track; one whose position stands still keeps its offset.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion, Skeleton
from stages.formats import euler
from stages.formats.bvh import BvhFile
from stages.formats.bvh_header import POSITION_CHANNELS, BvhJoint
from stages.kinematics import reference_pose
from stages.kinematics.body_groups import BodyParts, find_body_parts

STILL_M = 1e-4  # a position that moves less than this is still: exporters write rounding noise
_GUIDE_FRAMES = 16


def motion_of(
    bvh: BvhFile,
    *,
    fps_override: float | None = None,
    rest_frame: int | None = None,
    trim_first: str | int = 0,
) -> tuple[Skeleton, Motion, list[str]]:
    """The skeleton and motion of a BVH, Y up, metres.

    Args:
        fps_override: true frames per second where the file's frame time is wrong.
        rest_frame: a frame in which the figure stands upright, to find up axis and sides by.
        trim_first: frames to drop at the start, or "auto": one if frame 0 is a calibration pose far from frame 1.
    Returns: skeleton, motion (global float32 rotations), notes on what was found odd, one sentence each.
    Raises: InputError naming the file where no humanoid is found or an argument is out of range.
    """
    try:
        return _motion_of(bvh, fps_override, rest_frame, trim_first)
    except InputError as error:
        if error.message.startswith(bvh.name):
            raise
        raise InputError(f"{bvh.name}: {error.message}", error.hint) from None


def _motion_of(
    bvh: BvhFile, fps_override: float | None, rest_frame: int | None, trim_first: str | int
) -> tuple[Skeleton, Motion, list[str]]:
    notes = list(bvh.warnings)
    values = bvh.values
    if rest_frame is not None and not 0 <= rest_frame < len(values):
        raise InputError(f"Rest frame {rest_frame} is outside of its frames 0 to {len(values) - 1}.")
    body = _body_of(bvh.joints, values)
    heads = _positions(bvh.joints, body, values)
    local = local_quaternions(bvh.joints, values)
    rotations = _chain(local, body.parents)
    guides = _guide_frames(len(values)) if rest_frame is None else np.array([rest_frame])
    world = _world_positions(heads.select(guides), rotations[guides], body.parents)
    parts = body.parts
    up_axis = reference_pose.find_up_axis(body.rest, world, parts)
    turn = reference_pose.turn_to_y_up(up_axis)
    if not parts.sided:
        upright = world if turn is None else turn.apply(world.reshape(-1, 3)).reshape(world.shape)
        parts = parts.mirrored() if reference_pose.sides_are_swapped(upright, parts) else parts
        notes.append("Joint names tell no sides; left and right were found from the pose.")
    if body.unit_note:
        notes.append(f"No unit is certain: {body.unit_note}.")
    skeleton = _skeleton(bvh, body, parts, up_axis)
    roots = heads.root * body.unit_m
    if turn is not None:
        roots = turn.apply(roots)
        rotations = euler.multiply(turn.as_quat(), rotations)
    motion = Motion(
        rotations=_continuous(rotations).astype(np.float32),
        root_positions=roots.astype(np.float32),
        fps=fps_override or rate_of(bvh.frame_time),
        track_joints=np.array(heads.moving, np.int32),
        tracks=(heads.tracks * body.unit_m).astype(np.float32),
    )
    drop = _frames_to_trim(motion, skeleton, local, trim_first)
    if drop:
        notes.append(f"Dropped the first {drop} frame{'s' if drop > 1 else ''}.")
        motion = first_frames_dropped(motion, drop)
    return skeleton, motion, notes


def rate_of(frame_time: float) -> float:
    """Frames per second of a frame time that was rounded when written: 0.0333333 is 30, 0.0333667 is 29.97."""
    digits = len(np.format_float_positional(frame_time, trim="-").partition(".")[2])
    tolerance = min(10.0**-digits, 0.012 * frame_time)
    usual = (24, 25, 30, 48, 50, 60, 72, 75, 90, 100, 120, 144, 150, 180, 200, 240)
    nearest = round(1.0 / frame_time)
    for rate in (*usual, *([nearest] if nearest else [])):
        if abs(1.0 / rate - frame_time) <= tolerance:
            return float(rate)
    return 1.0 / frame_time


def first_frames_dropped(motion: Motion, count: int) -> Motion:
    """The motion from frame `count` on."""
    return Motion(
        rotations=motion.rotations[count:],
        root_positions=motion.root_positions[count:],
        fps=motion.fps,
        track_joints=motion.track_joints,
        tracks=motion.tracks[count:],
    )


# --- the figure, found once for files that share it -------------------------------------------------------------------


@dataclass(frozen=True)
class _Body:
    """What the header and the standing positions tell, in the file's unit and axes.

    offsets: (J, 3) heads in the parents' frames, joint 0 zeros; rest: (J, 3) joints at zero rotations.
    """

    names: tuple[str, ...]
    parents: np.ndarray
    offsets: np.ndarray
    rest: np.ndarray
    tails: np.ndarray
    on_chain: np.ndarray
    parts: BodyParts
    unit_m: float
    unit_note: str | None


def _body_of(joints: tuple[BvhJoint, ...], values: np.ndarray) -> _Body:
    """The figure. Positions given in rows count where they differ from the header's OFFSET."""
    header = np.array([joint.offset for joint in joints])
    offsets = header.copy()
    for index, axes, columns in _position_channels(joints):
        if index == 0:
            continue
        mean = values[:, columns].mean(axis=0)
        # Unit unknown as yet: "the same" is meant against the size of the offset itself.
        if np.abs(mean - header[index, axes]).max() > 1e-3 * max(np.linalg.norm(header[index]), 1e-6):
            offsets[index, axes] = mean
    return _analyse(joints, tuple(map(tuple, np.round(offsets, 6).tolist())))


@lru_cache(maxsize=64)
def _analyse(joints: tuple[BvhJoint, ...], offsets_key: tuple[tuple[float, ...], ...]) -> _Body:
    names = tuple(joint.name for joint in joints)
    parents = np.array([joint.parent for joint in joints], np.int32)
    offsets = np.array(offsets_key)
    end_sites = np.array([joint.end_site or (0.0, 0.0, 0.0) for joint in joints])
    parts = find_body_parts(names, parents, offsets, np.linalg.norm(end_sites, axis=1))
    offsets[0] = 0.0
    # What lies above the pelvis places the figure in the world and is no part of the figure.
    ancestor = parts.pelvis
    while ancestor > 0:
        if any(channel in POSITION_CHANNELS for channel in joints[ancestor].channels):
            offsets[ancestor] = 0.0
        ancestor = int(parents[ancestor])
    unit_m, note = reference_pose.find_unit(reference_pose.stature_of(offsets, parts))
    leaf = reference_pose.LEAF_LENGTH_M / unit_m
    tails, on_chain = reference_pose.bone_tails(names, parents, offsets, end_sites, parts, leaf)
    rest = np.zeros_like(offsets)
    for joint in range(1, len(parents)):
        rest[joint] = rest[parents[joint]] + offsets[joint]
    return _Body(names, parents, offsets, rest, tails, on_chain, parts, unit_m, note)


def _skeleton(bvh: BvhFile, body: _Body, parts: BodyParts, up_axis: str) -> Skeleton:
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
        header=bvh.header,
    )


# --- rows to poses ----------------------------------------------------------------------------------------------------


def _position_channels(joints: tuple[BvhJoint, ...]) -> Iterator[tuple[int, list[int], list[int]]]:
    """Joint, axes (0 to 2) and columns of every joint with position channels."""
    for index, joint in enumerate(joints):
        found = [
            (POSITION_CHANNELS.index(channel), joint.first_channel + i)
            for i, channel in enumerate(joint.channels)
            if channel in POSITION_CHANNELS
        ]
        if found:
            yield index, [axis for axis, _ in found], [column for _, column in found]


def rotation_channels(joint: BvhJoint) -> tuple[str, list[int]]:
    """Axes of a joint's rotation channels in their order, for example "ZXY", and their columns."""
    found = [
        (channel[0], joint.first_channel + i)
        for i, channel in enumerate(joint.channels)
        if channel not in POSITION_CHANNELS
    ]
    return "".join(axis for axis, _ in found), [column for _, column in found]


def local_quaternions(joints: tuple[BvhJoint, ...], values: np.ndarray) -> np.ndarray:
    """(T, J, 4) float64 rotations in the parents' frames, of rows (T, C)."""
    out = np.empty((len(values), len(joints), 4))
    by_order: dict[str, tuple[list[int], list[int]]] = {}
    for index, joint in enumerate(joints):
        axes, columns = rotation_channels(joint)
        indices, all_columns = by_order.setdefault(axes, ([], []))
        indices.append(index)
        all_columns.extend(columns)
    for axes, (indices, columns) in by_order.items():
        angles = values[:, columns].reshape(len(values), len(indices), len(axes))
        out[:, indices] = euler.to_quaternions(angles, axes)
    return out


@dataclass(frozen=True)
class _Heads:
    """Joints' heads in their parents' frames, file unit: offsets (J, 3), root (T, 3), tracks (T, K, 3) of `moving`."""

    offsets: np.ndarray
    root: np.ndarray
    moving: list[int]
    tracks: np.ndarray

    def select(self, frames: np.ndarray) -> _Heads:
        return _Heads(self.offsets, self.root[frames], self.moving, self.tracks[frames])


def _positions(joints: tuple[BvhJoint, ...], body: _Body, values: np.ndarray) -> _Heads:
    frames = len(values)
    root = np.tile(np.array(joints[0].offset), (frames, 1))
    moving: list[int] = []
    tracks: list[np.ndarray] = []
    for index, axes, columns in _position_channels(joints):
        given = values[:, columns]
        if index == 0:
            root[:, axes] = given
            continue
        strays = np.abs(given - body.offsets[index, axes]).max()
        if strays * body.unit_m > STILL_M:
            track = np.tile(np.array(joints[index].offset), (frames, 1))
            track[:, axes] = given
            moving.append(index)
            tracks.append(track)
    stacked = np.stack(tracks, axis=1) if tracks else np.zeros((frames, 0, 3))
    return _Heads(body.offsets, root, moving, stacked)


def _chain(local: np.ndarray, parents: np.ndarray) -> np.ndarray:
    """Global rotations (T, J, 4) of local ones, one depth of the tree at a time."""
    out = local.copy()
    for level in _levels(parents.tobytes()):
        out[:, level] = euler.multiply(out[:, parents[level]], local[:, level])
    return out


@lru_cache(maxsize=64)
def _levels(parents_bytes: bytes) -> list[np.ndarray]:
    """Joints below joint 0 by their depth, parents before children."""
    parents = np.frombuffer(parents_bytes, np.int32)
    depth = np.zeros(len(parents), int)
    for joint in range(1, len(parents)):
        depth[joint] = depth[parents[joint]] + 1
    return [np.flatnonzero(depth == d) for d in range(1, int(depth.max()) + 1)]


def _world_positions(heads: _Heads, rotations: np.ndarray, parents: np.ndarray) -> np.ndarray:
    """(F, J, 3) joint heads in the world, file unit and axes."""
    out = np.zeros((len(rotations), len(parents), 3))
    offsets = np.tile(heads.offsets, (len(rotations), 1, 1))
    offsets[:, heads.moving] = heads.tracks
    out[:, 0] = heads.root
    for joint in range(1, len(parents)):
        parent = int(parents[joint])
        out[:, joint] = out[:, parent] + euler.rotate(rotations[:, parent], offsets[:, joint])
    return out


def _guide_frames(frames: int) -> np.ndarray:
    """A few frames over the whole clip; not the first, which may be a calibration pose, if there are others."""
    return np.unique(np.linspace(min(1, frames - 1), frames - 1, _GUIDE_FRAMES).astype(int))


def _continuous(rotations: np.ndarray) -> np.ndarray:
    """Flip signs so that each quaternion lies on the same half as the one before it in time."""
    if len(rotations) < 2:
        return rotations
    agree = np.einsum("tjc,tjc->tj", rotations[1:], rotations[:-1])
    flips = np.where(agree < 0, -1.0, 1.0).cumprod(axis=0)
    rotations[1:] *= flips[..., None]
    return rotations


def _frames_to_trim(motion: Motion, skeleton: Skeleton, local: np.ndarray, trim_first: str | int) -> int:
    if str(trim_first) != "auto":
        try:
            count = int(trim_first)
        except ValueError:
            raise InputError(f"Frames to trim must be a number or auto, not '{trim_first}'.") from None
        if not 0 <= count < motion.frames:
            raise InputError(f"Cannot trim {count} of its {motion.frames} frames.")
        return count
    if motion.frames < 8:
        return 0
    place = motion.root_positions[:8].copy()
    for i, joint in enumerate(motion.track_joints):
        if joint <= skeleton.root:
            place += motion.tracks[:8, i]
    steps = np.linalg.norm(np.diff(place, axis=0), axis=1)
    turned = np.abs(np.einsum("tjc,tjc->tj", local[1:8], local[:7])).clip(max=1.0)
    turns = np.rad2deg(2 * np.arccos(turned)).max(axis=1)
    jumped = steps[0] > 0.1 and steps[0] > 5 * steps[1:].max()
    twisted = turns[0] > 30 and turns[0] > 5 * turns[1:].max()
    return int(jumped or twisted)


# --- poses to rows ----------------------------------------------------------------------------------------------------


def values_of(bvh: BvhFile, skeleton: Skeleton, motion: Motion, near: np.ndarray | None = None) -> np.ndarray:
    """Rows (T, C) float64 of a motion in the file's own unit, axes and channel orders: the inverse of `motion_of`.

    Args:
        bvh: the file that the motion's skeleton was read from (only its joints are used).
        motion: T frames on that skeleton.
        near: (T, C) rows to stay near to, choosing among equal Euler angles; where a row is NaN, or without `near`,
            the row before is the guide, so that curves never jump. Position channels of joints without a track take
            `near`'s value where there is one, else the skeleton's offset.
    """
    frames, columns = motion.frames, sum(len(joint.channels) for joint in bvh.joints)
    guide = np.full((frames, columns), np.nan) if near is None else near
    rotations = motion.rotations.astype(np.float64)
    roots = motion.root_positions.astype(np.float64)
    turn = reference_pose.turn_to_y_up(skeleton.up_axis)
    if turn is not None:
        rotations = euler.multiply(turn.inv().as_quat(), rotations)
        roots = turn.inv().apply(roots)
    local = rotations.copy()
    inverse = rotations[:, skeleton.parents[1:]] * np.array([-1.0, -1.0, -1.0, 1.0])
    local[:, 1:] = euler.multiply(inverse, rotations[:, 1:])
    local /= np.linalg.norm(local, axis=-1, keepdims=True)
    out = np.empty((frames, columns))
    for index, joint in enumerate(bvh.joints):
        axes, at = rotation_channels(joint)
        if axes:
            out[:, at] = euler.angles_near(local[:, index], axes, guide[:, at])
    _fill_positions(out, bvh.joints, skeleton, motion, roots, guide)
    return out


def _fill_positions(
    out: np.ndarray,
    joints: tuple[BvhJoint, ...],
    skeleton: Skeleton,
    motion: Motion,
    roots: np.ndarray,
    guide: np.ndarray,
) -> None:
    tracked = {int(joint): i for i, joint in enumerate(motion.track_joints)}
    for index, axes, columns in _position_channels(joints):
        if index == 0:
            out[:, columns] = roots[:, axes] / skeleton.unit_m
        elif index in tracked:
            out[:, columns] = motion.tracks[:, tracked[index]][:, axes].astype(np.float64) / skeleton.unit_m
        else:
            still = skeleton.offsets[index][axes] / skeleton.unit_m
            out[:, columns] = np.where(np.isfinite(guide[:, columns]), guide[:, columns], still)
