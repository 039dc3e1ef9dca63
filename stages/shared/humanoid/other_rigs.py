"""Clips retargeted to other rigs: to train with, so that motions do not identify their skeletons, and to measure."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from data_schemas.clips import ClipRow
from data_schemas.errors import InputError
from data_schemas.motion import MotionReader
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.humanoid.retargeting import retarget

APART_RAD = np.radians(40)  # largest distance between two reference poses from which a motion is retargeted
_POSE_CLIPS, _POSES_EACH = 8, 25  # of a rig, from which its reference pose is chosen
LONGEST = 1800  # most frames of one clip that are retargeted, from a random start


@dataclass(frozen=True)
class Rigs:
    """Skeletons by their id, and some poses of each."""

    skeletons: dict[str, Skeleton]
    poses: dict[str, Motion]


def rigs_of(reader: MotionReader, rows: Sequence[ClipRow]) -> Rigs:
    """The rigs that these clips are on."""
    clips: dict[str, list[ClipRow]] = {}
    for row in rows:
        clips.setdefault(row.skeleton, []).append(row)
    poses = {name: _poses(reader, own) for name, own in sorted(clips.items())}
    return Rigs({name: reader.skeleton(name) for name in poses}, poses)


def _poses(reader: MotionReader, rows: Sequence[ClipRow]) -> Motion:
    rotations, roots, fps = [], [], 30.0
    for row in [rows[index] for index in np.unique(np.linspace(0, len(rows) - 1, _POSE_CLIPS).astype(int))]:
        motion = reader.motion(row.clip)
        chosen = np.unique(np.linspace(0, motion.frames - 1, _POSES_EACH).astype(int))
        rotations.append(motion.rotations[chosen])
        roots.append(motion.root_positions[chosen])
        fps = motion.fps
    return Motion(np.concatenate(rotations), np.concatenate(roots), fps)


def on_another_rig(
    reader: MotionReader,
    row: ClipRow,
    motion: Motion,
    rigs: Rigs,
    seed: int,
    share: float = 1.0,
    longest: int = LONGEST,
) -> Iterator[tuple[ClipRow, Motion]]:
    """The clip on a random rig, for `share` of all clips; nothing if it cannot be retargeted.

    The draw depends on the seed and the clip's name only, not on the order of clips or on which other clips there are
    on the same rigs.

    Yields: the row, named CLIP@RIG with its source and split unchanged, and the motion, cut to at most
        `longest` frames.
    """
    rng = np.random.default_rng((seed, zlib.crc32(row.clip.encode("utf-8"))))
    others = [name for name in rigs.skeletons if name != row.skeleton]
    if not others or rng.random() >= share:
        return
    name = others[int(rng.integers(len(others)))]
    start = int(rng.integers(max(1, motion.frames - longest + 1)))
    part = motion.at(slice(start, start + longest))
    try:
        made = retarget(reader.skeleton(row.skeleton), part, rigs.skeletons[name], rigs.poses[name])
    except (
        InputError,
        ValueError,
    ):  # this clip cannot be retargeted to this rig: the rig lacks a limb, or the body is folded to a point
        return
    if made.apart_rad <= APART_RAD and np.isfinite(made.motion.root_positions).all():
        yield replace(row, clip=f"{row.clip}@{name}", skeleton=name), made.motion
