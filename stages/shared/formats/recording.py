"""What every reader is asked and what it gives: clips of motion on skeletons, with notes on what was odd."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.bvh_header_write import header_text, plain_names
from stages.shared.formats.figure import Poses, Rig, body_of, motion_of_poses
from stages.shared.formats.skeleton_map import SkeletonMap

MAX_JOINTS = 4096


@dataclass(frozen=True)
class Asked:
    """What the user said of a recording.

    fps_override: true frames per second, where the file says none or a wrong one.
    rest_frame, trim_first: as `stages.shared.formats.figure.motion_of_poses` takes them.
    rig, rig_name: bytes and name of the file that holds the skeleton, for formats that keep it apart.
    body_models: folder of SMPL-like body models.
    skeleton_maps: the user's word on rigs; for each rig the one that fits its joints is taken.
    """

    fps_override: float | None = None
    rest_frame: int | None = None
    trim_first: str | int = 0
    rig: bytes = b""
    rig_name: str = ""
    body_models: Path | None = None
    skeleton_maps: tuple[SkeletonMap, ...] = ()


@dataclass(frozen=True)
class Recording:
    """One clip of a file.

    part:    its name inside a file that holds several, else "".
    notes:   what was odd and was mended, one sentence each. remarks: what was taken as given, since no file says it.
    repaired_frames: frames with numbers that were none, filled in from their neighbours.
    """

    skeleton: Skeleton
    motion: Motion
    part: str = ""
    notes: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    repaired_frames: int = 0


def recording_of(
    name: str,
    rig: Rig,
    poses: Poses,
    asked: Asked,
    *,
    part: str = "",
    notes: Sequence[str] = (),
    remarks: Sequence[str] = (),
) -> Recording:
    """The clip of joints and poses that a reader found; joints in any order in which parents come first.

    Raises: InputError naming the file where the joints are no humanoid's.
    """
    rig, poses = depth_first(replace(rig, names=plain_names(rig.names), maps=asked.skeleton_maps), poses)
    moving = set(poses.moving)
    placed = [joint == 0 or joint in moving for joint in range(len(rig.names))]
    header = header_text(rig.names, rig.parents, rig.offsets, rig.end_sites, placed)
    try:
        skeleton, motion, found = motion_of_poses(
            body_of(rig), poses, header=header, up_axis=rig.up_axis,
            rest_frame=asked.rest_frame, trim_first=asked.trim_first,
        )  # fmt: skip
    except InputError as error:
        raise InputError(f"{name}: {error.message}", error.hint) from None
    return Recording(skeleton, motion, part, [*notes, *found], list(remarks))


def check_room(name: str, size: int, frames: int, joints: int) -> None:
    """Refuse a file of `size` bytes that would make more poses than such a file tells.

    A pose of a joint takes some 60 bytes while it is read; a file may take 64 MB and ten times its own size.
    """
    if frames * joints > 1_000_000 + size // 6:
        raise InputError(
            f"{name} would make {frames} frames of {joints} joints, which is more than {size / 1e6:.1f} MB tell.",
            "Split it, or name a skeleton with fewer joints.",
        )


def depth_first(rig: Rig, poses: Poses) -> tuple[Rig, Poses]:
    """The same figure with its joints in the order in which a BVH lists them."""
    children: list[list[int]] = [[] for _ in rig.names]
    for joint, parent in enumerate(rig.parents):
        if parent >= 0:
            children[parent].append(joint)
    order: list[int] = []
    to_do = [0]
    while to_do:
        joint = to_do.pop()
        order.append(joint)
        to_do += reversed(children[joint])
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
        local=poses.local[:, order],
        moving=[moving[i] for i in by_place],
        tracks=poses.tracks[:, by_place] if len(moving) else poses.tracks,
    )
