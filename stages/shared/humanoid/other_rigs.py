"""Clips on rigs not theirs: to train with, so that a motion does not tell its skeleton, and to measure on such."""

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

APART_RAD = np.radians(40)  # two reference poses further apart than this are no base to carry a motion over from
_POSE_CLIPS, _POSES_EACH = 8, 25  # of a rig, to find a reference pose among
_LONGEST = 1800  # frames of one clip that are carried over, from a place drawn at random


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
    reader: MotionReader, row: ClipRow, motion: Motion, rigs: Rigs, seed: int, share: float = 1.0
) -> Iterator[tuple[ClipRow, Motion]]:
    """The clip on a rig that is drawn for it, for `share` of all clips; nothing where it cannot be carried over.

    What is drawn follows from the seed and the clip's name: the order of clips, and which others there are on the
    same rigs, mean nothing.

    Yields: the row, named CLIP@RIG with its source and split as they were, and the motion, cut to at most a minute at
        30 frames a second.
    """
    rng = np.random.default_rng((seed, zlib.crc32(row.clip.encode("utf-8"))))
    others = [name for name in rigs.skeletons if name != row.skeleton]
    if not others or rng.random() >= share:
        return
    name = others[int(rng.integers(len(others)))]
    start = int(rng.integers(max(1, motion.frames - _LONGEST + 1)))
    part = motion.at(slice(start, start + _LONGEST))
    try:
        made = retarget(reader.skeleton(row.skeleton), part, rigs.skeletons[name], rigs.poses[name])
    except (InputError, ValueError):  # a rig that lacks a limb, a figure folded to a point: this pair teaches nothing
        return
    if made.apart_rad <= APART_RAD and np.isfinite(made.motion.root_positions).all():
        yield replace(row, clip=f"{row.clip}@{name}", skeleton=name), made.motion
