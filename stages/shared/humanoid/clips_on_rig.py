"""Clips as rotations of one rig's body at one rate: taken as they are from corresponding rigs, else retargeted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data_schemas.clips import ClipRow
from data_schemas.errors import InputError
from data_schemas.motion import MotionReader
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.humanoid.other_rigs import APART_RAD
from stages.shared.humanoid.retargeting import retarget
from stages.shared.kinematics.forward_numpy import local_rotations, positions_of
from stages.shared.kinematics.resampling import resample, resampled_frames
from stages.shared.kinematics.rotations import continuous_signs

STATURE_M = 1.8  # bodies are scaled to it, so that errors of all rigs compare
_LIKE_COSINE = np.cos(np.radians(25))  # least, between the offsets of corresponding joints of corresponding rigs
_SHORT_M = 0.02  # offsets below this have no direction that counts
_STATURE_FRAMES = 400


@dataclass(frozen=True)
class RigBodyJoints:
    """The joints of a rig's body, fingers included, scaled to a stature of 1.80 m.

    skeleton: as its clips have it. joints: (B,) of the body, the pelvis first, parents before children.
    parents:  (B,) int64 within the body, -1 for the pelvis. groups: (B,) body groups.
    offsets:  (B, 3) float32 metres of the scaled body, heads in the parents' frames; the pelvis' are 0.
    scale:    from the skeleton's own metres to the scaled body's.
    """

    skeleton: Skeleton
    joints: np.ndarray
    parents: np.ndarray
    groups: np.ndarray
    offsets: np.ndarray
    scale: float


@dataclass(frozen=True)
class RotationClip:
    """One clip on the rig: local (T, B, 4) float32 xyzw, rotations in the parents' frames, the pelvis' in the world.

    retargeted:   whether it was on a rig that does not correspond. interpolated: whether its own rate was lower than,
                  or no multiple of, the rate asked for.
    """

    row: ClipRow
    local: np.ndarray
    retargeted: bool
    interpolated: bool


def body_joints_of(skeleton: Skeleton, stature_m: float) -> RigBodyJoints:
    """The body of a skeleton whose stature is `stature_m` metres."""
    joints = np.flatnonzero(np.asarray(skeleton.groups) >= 0)
    place = {int(joint): index for index, joint in enumerate(joints)}
    parents = np.array([place.get(int(skeleton.parents[joint]), -1) for joint in joints], np.int64)
    scale = STATURE_M / stature_m
    offsets = (scale * skeleton.offsets[joints]).astype(np.float32)
    offsets[0] = 0
    return RigBodyJoints(skeleton, joints, parents, np.asarray(skeleton.groups)[joints], offsets, scale)


def rig_of_clips(reader: MotionReader, rows: Sequence[ClipRow]) -> tuple[Skeleton, float]:
    """The skeleton of most frames of these clips, and its stature in metres.

    Raises: InputError if there is no clip.
    """
    if not rows:
        raise InputError(f"{reader.artefact.path} has no clip of these splits.", "Take other splits.")
    frames: Counter[str] = Counter()
    for row in rows:
        frames[row.skeleton] += row.frames
    name = frames.most_common(1)[0][0]
    own = [row for row in rows if row.skeleton == name]
    skeleton = reader.skeleton(name)
    share = max(1, _STATURE_FRAMES // len(own))
    heights = [_heights(skeleton, _some(reader.motion(row.clip), share)) for row in own[:_STATURE_FRAMES]]
    return skeleton, float(np.percentile(np.concatenate(heights), 90))


def clips_on_rig(
    reader: MotionReader,
    rows: Sequence[ClipRow],
    body: RigBodyJoints,
    rate_hz: float,
    least: int,
    longest_s: float = 0.0,
) -> tuple[list[RotationClip], list[str]]:
    """The clips on the rig at a rate, and what was left out or changed, one sentence each.

    Args:
        least: frames, at the rate, of the shortest clip that is of use.
        longest_s: seconds of each clip, from its start; 0 for all.
    Raises: InputError if no clip is of use.
    """
    found: list[RotationClip] = []
    left: Counter[str] = Counter()
    for row in rows:
        frames = frames_read(row, longest_s)
        if resampled_frames(frames, row.fps, rate_hz) < least:
            left["shorter than a window"] += 1
            continue
        motion = reader.motion(row.clip, 0, frames)
        whole = row.fps / rate_hz
        interpolated = abs(whole - round(whole)) > 1e-3 or whole < 1
        source = reader.skeleton(row.skeleton)
        made = skeleton_on_rig(source, motion, body, rate_hz)
        if made is None:
            left["impossible to retarget"] += 1
            continue
        skeleton, motion, joints = made
        found.append(RotationClip(row, local_on_rig(motion, joints, body), skeleton is not source, interpolated))
    if not found:
        why = ", ".join(f"{count} {reason}" for reason, count in left.items())
        raise InputError(
            f"{reader.artefact.path} has no clip of use at {rate_hz:g} frames a second: {why or 'it is empty'}.",
            f"A window has {least} frames, {least / rate_hz:.2f} seconds; take a shorter one, or longer clips.",
        )
    return found, _sentences(found, left, rate_hz)


def frames_read(row: ClipRow, longest_s: float) -> int:
    """How many frames of a clip are read, from its start: at most `longest_s` seconds; 0 for all."""
    return min(row.frames, max(2, round(longest_s * row.fps))) if longest_s else row.frames


def motion_on_rig(
    source: Skeleton, motion: Motion, body: RigBodyJoints, rate_hz: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """A motion on the rig at a rate: local rotations (T, B, 4) float32 and places of the pelvis (T, 3) metres, in the
    size of the body that it moves; None if it cannot be retargeted."""
    made = skeleton_on_rig(source, motion, body, rate_hz)
    if made is None:
        return None
    skeleton, motion, joints = made
    return local_on_rig(motion, joints, body), positions_of(skeleton, motion)[:, joints[0]]


def skeleton_on_rig(
    source: Skeleton, motion: Motion, body: RigBodyJoints, rate_hz: float
) -> tuple[Skeleton, Motion, np.ndarray] | None:
    """The skeleton that the motion moves, the motion at the rate, and the joints of the skeleton's body: its own
    where it corresponds to the rig, else the rig's; None if it cannot be retargeted."""
    skeleton, joints = source, np.flatnonzero(np.asarray(source.groups) >= 0)
    if not is_corresponding(source, body.skeleton):
        made = _retargeted(source, motion, body.skeleton)
        if made is None:
            return None
        skeleton, motion, joints = body.skeleton, made, body.joints
    return skeleton, resample(motion, rate_hz), joints


def local_on_rig(motion: Motion, joints: np.ndarray, body: RigBodyJoints) -> np.ndarray:
    """(T, B, 4) float32 rotations in the parents' frames, of joints as `skeleton_on_rig` gives them."""
    return continuous_signs(local_rotations(motion.rotations[:, joints], body.parents)).astype(np.float32)


def is_corresponding(one: Skeleton, other: Skeleton) -> bool:
    """Whether two rigs have the same joints of the body, whose bones point the same ways at rest within 25 degrees.

    Rotations in the parents' frames then mean the same on both, whatever their bones' lengths are. Joints named alike
    are not needed: CMU's bodies have other names in ASF than in BVH.
    """
    bodies = [np.flatnonzero(np.asarray(each.groups) >= 0) for each in (one, other)]
    if len(bodies[0]) != len(bodies[1]):
        return False
    first, second = (body_joints_of(each, STATURE_M) for each in (one, other))
    if not (np.array_equal(first.parents, second.parents) and np.array_equal(first.groups, second.groups)):
        return False
    lengths = np.linalg.norm(first.offsets, axis=1), np.linalg.norm(second.offsets, axis=1)
    cosines = (first.offsets * second.offsets).sum(1) / np.maximum(lengths[0] * lengths[1], 1e-12)
    return bool(((np.minimum(*lengths) < _SHORT_M) | (cosines > _LIKE_COSINE)).all())


def _retargeted(source: Skeleton, motion: Motion, target: Skeleton) -> Motion | None:
    try:
        made = retarget(source, motion, target)
    except (InputError, ValueError):  # a limb is missing, or the body is folded to a point
        return None
    return made.motion if made.apart_rad <= APART_RAD else None


def _sentences(found: Sequence[RotationClip], left: Counter[str], rate_hz: float) -> list[str]:
    out = [f"{count} clips were left out: {reason}." for reason, count in sorted(left.items())]
    retargeted = sum(clip.retargeted for clip in found)
    if retargeted:
        out.append(f"{retargeted} of {len(found)} clips were retargeted to the rig.")
    rates = sorted({clip.row.fps for clip in found if clip.interpolated})
    if rates:
        out.append(
            f"{sum(clip.interpolated for clip in found)} of {len(found)} clips were interpolated to {rate_hz:g} "
            f"frames a second, from {', '.join(f'{rate:g}' for rate in rates)}."
        )
    return out


def _some(motion: Motion, count: int) -> Motion:
    return motion.at(np.unique(np.linspace(0, motion.frames - 1, count).astype(int)))


def _heights(skeleton: Skeleton, motion: Motion) -> np.ndarray:
    """(T,) metres from the lowest to the highest joint of spine and legs; arms may be raised."""
    groups = np.asarray(skeleton.groups)
    return np.ptp(positions_of(skeleton, motion)[:, (groups == 0) | (groups >= 3), 1], axis=1)
