"""The rig that an estimate is put on: the user's BVH, or the one that the weights hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch

from data_schemas.errors import UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of, values_of
from stages.shared.formats.bvh_write import write_bvh
from stages.shared.formats.sources import source_named
from stages.shared.formats.writers import bytes_of_motion, written_format
from stages.shared.pointcloud.rig import Rig


@dataclass(frozen=True)
class Target:
    """skeleton: the rig's joints. poses: a motion of it, one frame of which may become the reference pose.

    written: the bytes of a motion of it as a file of this name, and notes on what they do not hold.
    """

    skeleton: Skeleton
    poses: Motion
    written: Callable[[Motion, Path], tuple[bytes, list[str]]]
    notes: list[str]


def target_of(path: Path | None, own: Rig | None) -> Target:
    """The rig of a BVH, or else the weights' own.

    Raises: InputError if the file is no humanoid's BVH; UsageError if there is neither.
    """
    if path is None:
        if own is None:
            raise UsageError("There is no rig to put the motion on.", "Give --skeleton rig.bvh.")
        rest = own.motion(torch.zeros(1, 3), own.body.rest_world[None], 30.0)
        return Target(own.skeleton, rest, lambda made, file: _in_format(own.skeleton, made, file), [])
    source = source_named(str(path))
    bvh = read_bvh(source.read(), source.name)
    skeleton, poses, notes = motion_of(bvh)

    def written(made: Motion, file: Path) -> tuple[bytes, list[str]]:
        if file.suffix.lower() != ".bvh":
            return _in_format(skeleton, made, file)
        rows = values_of(bvh, skeleton, made)
        return write_bvh(bvh, rows, frame_count=made.frames, frame_time=1 / made.fps), []

    return Target(skeleton, poses, written, [f"{path}: {note}" for note in notes])


def _in_format(skeleton: Skeleton, made: Motion, file: Path) -> tuple[bytes, list[str]]:
    return bytes_of_motion(written_format(file), skeleton, made, file.stem)
