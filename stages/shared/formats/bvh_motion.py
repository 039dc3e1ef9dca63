"""Converting a BVH to a Skeleton and a Motion; `values_of` (`stages.shared.formats.bvh_rows`) is the inverse.

Position channels replace a joint's OFFSET, which is how exporters of such files use them. A joint below joint 0 gets
a translation track if its position varies; otherwise it keeps its offset.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from data_schemas.errors import InputError
from data_schemas.notes import Note, sentences_of
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.bvh import BvhFile, read_bvh
from stages.shared.formats.bvh_header import POSITION_CHANNELS, BvhJoint
from stages.shared.formats.bvh_rows import RowRotations, layout_of, values_of
from stages.shared.formats.recording import Asked, Recording
from stages.shared.formats.skeleton_map import SkeletonMap
from stages.shared.formats.source_body import SourceBody, SourcePoses, SourceRig, ancestors, body_of, motion_of_poses

__all__ = ["motion_of", "rate_of", "read_bvh_motion", "rig_and_poses", "values_of"]

STILL_M = 1e-4  # a position that moves less than this is constant: exporters write rounding noise


def read_bvh_motion(data: bytes, name: str, asked: Asked) -> list[Recording]:
    """The one clip of a BVH. Raises InputError naming file, line and joint."""
    skeleton, motion, notes = noted_motion_of(
        read_bvh(data, name),
        fps_override=asked.fps_override, rest_frame=asked.rest_frame, trim_first=asked.trim_first,
        skeleton_maps=asked.skeleton_maps, up_axis=asked.up_axis,
    )  # fmt: skip
    return [Recording(skeleton, motion, notes=notes)]


def motion_of(
    bvh: BvhFile,
    *,
    fps_override: float | None = None,
    rest_frame: int | None = None,
    trim_first: str | int = 0,
    skeleton_maps: tuple[SkeletonMap, ...] = (),
    up_axis: str | None = None,
) -> tuple[Skeleton, Motion, list[str]]:
    """The skeleton and motion of a BVH, Y up, metres.

    Args:
        fps_override: true frames per second if the file's frame time is wrong.
        rest_frame: a frame in which the body stands upright, from which up axis and sides are found.
        trim_first: frames to drop at the start, or "auto": one if frame 0 is a calibration pose far from frame 1.
        skeleton_maps: the user's skeleton maps; the one that matches the joints is used.
        up_axis: the file's, "y" or "z", if it is not the one that the body shows.
    Returns: skeleton, motion (global float32 rotations), notes on the file's oddities, one sentence each.
    Raises: InputError naming the file if no humanoid is found or an argument is out of range.
    """
    skeleton, motion, notes = noted_motion_of(
        bvh, fps_override=fps_override, rest_frame=rest_frame, trim_first=trim_first, skeleton_maps=skeleton_maps,
        up_axis=up_axis,
    )  # fmt: skip
    return skeleton, motion, sentences_of(notes)


def noted_motion_of(
    bvh: BvhFile,
    *,
    fps_override: float | None = None,
    rest_frame: int | None = None,
    trim_first: str | int = 0,
    skeleton_maps: tuple[SkeletonMap, ...] = (),
    up_axis: str | None = None,
) -> tuple[Skeleton, Motion, list[Note]]:
    """As `motion_of`, with notes as codes and figures instead of sentences."""
    try:
        body = _body_of(bvh.joints, bvh.values, skeleton_maps)
        poses = _poses(bvh.joints, body, bvh.values, fps_override or rate_of(bvh.frame_time))
        skeleton, motion, notes = motion_of_poses(
            body, poses, header=bvh.header, up_axis=up_axis, rest_frame=rest_frame, trim_first=trim_first
        )
    except InputError as error:
        raise InputError(f"{bvh.name}: {error.message}", error.hint) from None
    return skeleton, motion, [*bvh.warnings, *notes]


def rig_and_poses(bvh: BvhFile) -> tuple[SourceRig, SourcePoses]:
    """The joints and poses of a BVH, in the file's unit and axes, as `stages.shared.formats.source_body` has them.

    Raises: InputError if the joints are not those of a humanoid.
    """
    body = _body_of(bvh.joints, bvh.values)
    offsets = tuple((x, y, z) for x, y, z in body.offsets.tolist())
    poses = _poses(bvh.joints, body, bvh.values, rate_of(bvh.frame_time))
    return _rig(bvh.joints, offsets), replace(poses, local=poses.local[:])


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


def _body_of(joints: tuple[BvhJoint, ...], values: np.ndarray, maps: tuple[SkeletonMap, ...] = ()) -> SourceBody:
    """The body. A joint's position in the rows is used where it differs from the header's OFFSET."""
    header = tuple(joint.offset for joint in joints)
    try:
        body = body_of(_rig(joints, header, maps))
        placing = {body.parts.pelvis, *ancestors(body.parents, body.parts.pelvis)}
    except InputError:  # the header alone makes no body; perhaps the rows do
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
    return body_of(_rig(joints, tuple(map(tuple, offsets.tolist())), maps))


@lru_cache(maxsize=64)
def _rig(
    joints: tuple[BvhJoint, ...],
    offsets: tuple[tuple[float, float, float], ...],
    maps: tuple[SkeletonMap, ...] = (),
) -> SourceRig:
    return SourceRig(
        names=tuple(joint.name for joint in joints),
        parents=tuple(joint.parent for joint in joints),
        offsets=offsets,
        end_sites=tuple(joint.end_site or (0.0, 0.0, 0.0) for joint in joints),
        placed=tuple(any(channel in POSITION_CHANNELS for channel in joint.channels) for joint in joints),
        maps=maps,
    )


def _poses(joints: tuple[BvhJoint, ...], body: SourceBody, values: np.ndarray, fps: float) -> SourcePoses:
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
    return SourcePoses(RowRotations(joints, values), root, fps, moving, tracks)
