"""A BVH to a Skeleton and a Motion; `values_of` (from `stages.formats.bvh_rows`) is the way back.

Position channels replace a joint's OFFSET, as every exporter of such files means it. A joint below joint 0 whose
position varies gets a translation track; one whose position stands still keeps its offset.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion, Skeleton
from stages.formats import euler
from stages.formats.bvh import BvhFile
from stages.formats.bvh_header import POSITION_CHANNELS, BvhJoint
from stages.formats.bvh_rows import layout_of, local_quaternions, values_of
from stages.kinematics import reference_pose
from stages.kinematics.body_groups import BodyParts, find_body_parts

__all__ = ["motion_of", "places_of", "rate_of", "values_of"]

STILL_M = 1e-4  # a position that moves less than this is still: exporters write rounding noise
_GUIDE_FRAMES = 16
_TRIM_LOOKAHEAD = 32
_JUMP_M = 0.25  # between two frames; a joint of a living body stays below


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
    opening = np.arange(min(_TRIM_LOOKAHEAD, len(values)))
    looked_at = np.concatenate([opening, guides])
    world = _world_positions(heads.select(looked_at), rotations[looked_at], body.parents)
    world, opening_world = world[len(opening) :], world[: len(opening)] * body.unit_m
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
        rotations=np.ascontiguousarray(_continuous(rotations), np.float32),
        root_positions=roots.astype(np.float32),
        fps=fps_override or rate_of(bvh.frame_time),
        track_joints=np.array(heads.moving, np.int32),
        tracks=(heads.tracks * body.unit_m).astype(np.float32),
    )
    drop = _frames_to_trim(motion.frames, opening_world[:, skeleton.sampled], trim_first)
    if drop:
        why = ": a calibration pose and what swings in from it" if str(trim_first) == "auto" else ""
        notes.append(f"Dropped the first {f'{drop} frames' if drop > 1 else 'frame'}{why}.")
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


# --- the figure, found once for files that share it ---------------------------------------------


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
    header = tuple(joint.offset for joint in joints)
    try:
        body = _analyse(joints, header)
        placing = {body.parts.pelvis, *_ancestors(body.parents, body.parts.pelvis)}
    except InputError:  # the header alone makes no figure; perhaps the rows do
        body, placing = None, {0}
    layout = layout_of(joints)
    is_placing = np.zeros(len(joints), bool)
    is_placing[list(placing)] = True
    offsets = np.array(header)
    at = (layout.position_joints, layout.position_axes)
    mean = values[:, layout.position_columns].mean(axis=0)
    sizes = np.maximum(np.linalg.norm(offsets, axis=1), 1e-6)[layout.position_joints]
    # The unit is not known yet: "differs" is meant against the size of the offset itself. Less is a track's affair:
    # clips of one rig must not have skeletons of their own because they move a joint a little.
    differs = (np.abs(mean - offsets[at]) > 1e-2 * sizes) & ~is_placing[layout.position_joints]
    if body is not None and not differs.any():
        return body
    offsets[at[0][differs], at[1][differs]] = np.round(mean[differs], 6)
    return _analyse(joints, tuple(map(tuple, offsets.tolist())))


def _ancestors(parents: np.ndarray, joint: int) -> list[int]:
    above = []
    while parents[joint] >= 0:
        joint = int(parents[joint])
        above.append(joint)
    return above


@lru_cache(maxsize=64)
def _analyse(joints: tuple[BvhJoint, ...], offsets_key: tuple[tuple[float, ...], ...]) -> _Body:
    names = tuple(joint.name for joint in joints)
    parents = np.array([joint.parent for joint in joints], np.int32)
    offsets = np.array(offsets_key)
    end_sites = np.array([joint.end_site or (0.0, 0.0, 0.0) for joint in joints])
    parts = find_body_parts(names, parents, offsets, np.linalg.norm(end_sites, axis=1))
    offsets[0] = 0.0
    # What lies above the pelvis places the figure in the world and is no part of the figure.
    for joint in (parts.pelvis, *_ancestors(parents, parts.pelvis)):
        if any(channel in POSITION_CHANNELS for channel in joints[joint].channels):
            offsets[joint] = 0.0
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


# --- rows to poses ------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Heads:
    """Heads in the parents' frames, file unit: offsets (J, 3), root (T, 3), tracks (T, K, 3) of joints `moving`."""

    offsets: np.ndarray
    root: np.ndarray
    moving: list[int]
    tracks: np.ndarray

    def select(self, frames: np.ndarray) -> _Heads:
        return _Heads(self.offsets, self.root[frames], self.moving, self.tracks[frames])


def _positions(joints: tuple[BvhJoint, ...], body: _Body, values: np.ndarray) -> _Heads:
    layout = layout_of(joints)
    given = values[:, layout.position_columns]
    root = np.tile(np.array(joints[0].offset), (len(values), 1))
    axes, columns = layout.positions_of(0)
    root[:, axes] = values[:, columns]
    still = body.offsets[layout.position_joints, layout.position_axes]
    strays = np.abs(given - still).max(axis=0, initial=0.0) * body.unit_m > STILL_M
    moving = [int(joint) for joint in np.unique(layout.position_joints[strays]) if joint > 0]
    tracks = np.zeros((len(values), len(moving), 3))
    for i, joint in enumerate(moving):
        tracks[:, i] = joints[joint].offset
        axes, columns = layout.positions_of(joint)
        tracks[:, i, axes] = values[:, columns]
    return _Heads(body.offsets, root, moving, tracks)


def _chain(local: np.ndarray, parents: np.ndarray) -> np.ndarray:
    """Global rotations (T, J, 4) of local ones, one depth of the tree at a time."""
    parts = local.transpose(2, 1, 0)
    out = parts.copy()
    for level in _levels(parents.tobytes()):
        out[:, level] = euler.multiply_parts(out[:, parents[level]], parts[:, level])
    return out.transpose(2, 1, 0)


@lru_cache(maxsize=64)
def _levels(parents_bytes: bytes) -> list[np.ndarray]:
    """Joints below joint 0 by their depth, parents before children."""
    parents = np.frombuffer(parents_bytes, np.int32)
    depth = np.zeros(len(parents), int)
    for joint in range(1, len(parents)):
        depth[joint] = depth[parents[joint]] + 1
    return [np.flatnonzero(depth == d) for d in range(1, int(depth.max()) + 1)]


def places_of(skeleton: Skeleton, motion: Motion) -> np.ndarray:
    """(T, J, 3) float64 joint heads in the world, metres, without loading torch as the floors above do."""
    heads = _Heads(skeleton.offsets, motion.root_positions, motion.track_joints.tolist(), motion.tracks)
    return _world_positions(heads, motion.rotations.astype(np.float64), skeleton.parents)


def _world_positions(heads: _Heads, rotations: np.ndarray, parents: np.ndarray) -> np.ndarray:
    """(F, J, 3) joint heads in the world, in the heads' unit and axes."""
    out = np.zeros((len(rotations), len(parents), 3))
    offsets = np.tile(heads.offsets, (len(rotations), 1, 1))
    offsets[:, heads.moving] = heads.tracks
    out[:, 0] = heads.root
    for level in _levels(parents.tobytes()):
        above = parents[level]
        out[:, level] = out[:, above] + euler.rotate(rotations[:, above], offsets[:, level])
    return out


def _guide_frames(frames: int) -> np.ndarray:
    """A few frames over the whole clip; not the first, which may be a calibration pose, if there are others."""
    return np.unique(np.linspace(min(1, frames - 1), frames - 1, _GUIDE_FRAMES).astype(int))


def _continuous(rotations: np.ndarray) -> np.ndarray:
    """Flip signs so that each quaternion lies on the same half as the one before it in time."""
    parts = rotations.transpose(2, 1, 0)
    agree = (parts[..., 1:] * parts[..., :-1]).sum(axis=0)
    flips = np.where(agree < 0, -1.0, 1.0).cumprod(axis=1)
    parts[..., 1:] *= flips
    return parts.transpose(2, 1, 0)


def _frames_to_trim(frames: int, opening: np.ndarray, trim_first: str | int) -> int:
    """How many frames to drop; `opening` (F, J, 3) metres are the seen joints in the first frames."""
    if str(trim_first) != "auto":
        try:
            count = int(trim_first)
        except ValueError:
            raise InputError(f"Frames to trim must be a number or auto, not '{trim_first}'.") from None
        if not 0 <= count < frames:
            raise InputError(f"Cannot trim {count} of its {frames} frames.")
        return count
    steps = np.linalg.norm(np.diff(opening, axis=0), axis=-1).max(axis=1)
    if len(steps) < 8 or steps[0] < _JUMP_M or steps[0] < 2 * steps[1:8].max():
        return 0
    # A filter ran over such a jump in many recordings: limbs still swing in from it for a few frames.
    usual = float(np.median(steps[8:])) if len(steps) > 8 else 0.0
    count = 1
    while count < 8 and usual and steps[count] > 3 * usual and steps[count] > 0.02:
        count += 1
    return count
