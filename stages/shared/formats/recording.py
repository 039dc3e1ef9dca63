"""Input and output of every reader: the user's settings, and clips of motion on skeletons with notes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from data_schemas.errors import InputError
from data_schemas.notes import Note
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.bvh_header_write import header_text, plain_names
from stages.shared.formats.skeleton_map import SkeletonMap
from stages.shared.formats.source_body import SourcePoses, SourceRig, body_of, motion_of_poses
from stages.shared.humanoid.reference_pose import rest_axis

MAX_JOINTS = 4096


@dataclass(frozen=True)
class Asked:
    """The user's settings for reading a recording.

    fps_override: true frames per second, if the file states none or a wrong one.
    rest_frame, trim_first: see `stages.shared.formats.source_body.motion_of_poses`.
    rig, rig_name: bytes and name of the skeleton file, for formats that keep it in a file of its own.
    body_models: folder of SMPL-like body models.
    skeleton_maps: the user's skeleton maps; for each rig the one that matches its joints is used.
    up_axis: the source's up axis, "y" or "z", if it is not the one that its format states or its body shows.
    usual_units: for files of positions that state no unit: rigs (`positions.rig_key`) of the same data set, each with
        the metres in its usual unit.
    """

    fps_override: float | None = None
    rest_frame: int | None = None
    trim_first: str | int = 0
    rig: bytes = b""
    rig_name: str = ""
    body_models: Path | None = None
    skeleton_maps: tuple[SkeletonMap, ...] = ()
    up_axis: str | None = None
    usual_units: tuple[tuple[tuple[str, ...], float], ...] = ()


@dataclass(frozen=True)
class Recording:
    """One clip of a file.

    part:    its name if the file holds several clips, else "".
    notes:   faults that were corrected. remarks: assumptions about facts that no file states.
    repaired_frames: frames with values that were not numbers, filled in from their neighbours.
    """

    skeleton: Skeleton
    motion: Motion
    part: str = ""
    notes: list[Note] = field(default_factory=list)
    remarks: list[Note] = field(default_factory=list)
    repaired_frames: int = 0


def recording_of(
    name: str,
    rig: SourceRig,
    poses: SourcePoses,
    asked: Asked,
    *,
    part: str = "",
    notes: Sequence[Note] = (),
    remarks: Sequence[Note] = (),
) -> Recording:
    """The clip of the joints and poses that a reader found; joints in any order with parents before children.

    Raises: InputError naming the file if the joints are not those of a humanoid.
    """
    if asked.up_axis is not None:
        rig = replace(rig, up_axis=asked.up_axis)
    rig, poses = depth_first(replace(rig, names=plain_names(rig.names), maps=asked.skeleton_maps), poses)
    moving = set(poses.moving)
    placed = [joint == 0 or joint in moving for joint in range(len(rig.names))]
    header = header_text(rig.names, rig.parents, rig.offsets, rig.end_sites, placed)
    try:
        body = body_of(rig)
        skeleton, motion, found = motion_of_poses(
            body, poses, header=header, up_axis=rig.up_axis,
            rest_frame=asked.rest_frame, trim_first=asked.trim_first,
        )  # fmt: skip
    except InputError as error:
        raise InputError(f"{name}: {error.message}", error.hint) from None
    # A BVH is written in the axes of its header, which is made here from the rest pose. The rest pose can have
    # another up axis than the motion: AMASS' is Y up, and its motion Z up.
    skeleton = replace(skeleton, up_axis=rest_axis(body.rest, body.parts) or skeleton.up_axis)
    return Recording(skeleton, motion, part, [*notes, *found], list(remarks))


def check_room(name: str, size: int, frames: int, joints: int) -> None:
    """Raise InputError if a file of `size` bytes would give more poses than a file of this size can hold.

    One joint's pose takes about 60 bytes while it is read; a file may take 64 MB plus ten times its own size.
    """
    if frames * joints > 1_000_000 + size // 6:
        raise InputError(
            f"{name} would give {frames} frames of {joints} joints, which is too many for {size / 1e6:.1f} MB.",
            "Split it, or name a skeleton with fewer joints.",
        )


def joints_depth_first(parents: Sequence[int]) -> list[int]:
    """The joints in depth-first order; children of one joint stay in order. parents: -1 for joint 0."""
    children: list[list[int]] = [[] for _ in parents]
    for joint, parent in enumerate(parents):
        if parent >= 0:
            children[parent].append(joint)
    order: list[int] = []
    to_do = [0]
    while to_do:
        joint = to_do.pop()
        order.append(joint)
        to_do += reversed(children[joint])
    return order


def depth_first(rig: SourceRig, poses: SourcePoses) -> tuple[SourceRig, SourcePoses]:
    """The same rig and poses with the joints in depth-first order, the order of a BVH."""
    order = joints_depth_first(rig.parents)
    if order == list(range(len(order))):
        return rig, poses
    place = {joint: index for index, joint in enumerate(order)}
    rig = replace(
        rig,
        names=tuple(rig.names[joint] for joint in order),
        parents=tuple(place[rig.parents[joint]] if rig.parents[joint] >= 0 else -1 for joint in order),
        offsets=tuple(rig.offsets[joint] for joint in order),
        end_sites=tuple(rig.end_sites[joint] for joint in order),
        placed=tuple(rig.placed[joint] for joint in order),
    )
    moving = [place[joint] for joint in poses.moving]
    by_place = np.argsort(moving).astype(int)
    return rig, replace(
        poses,
        local=poses.local[:][:, order],
        moving=[moving[i] for i in by_place],
        tracks=poses.tracks[:, by_place] if len(moving) else poses.tracks,
    )
