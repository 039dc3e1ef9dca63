"""What a motion is put on: the rig of a BVH, or a robot of a URDF."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from data_schemas.errors import UsageError
from data_schemas.notes import sentences_of
from data_schemas.skeleton import Motion, Skeleton
from stages.retarget.config import Config
from stages.shared.formats.bvh import BvhFile, read_bvh
from stages.shared.formats.bvh_motion import motion_of, values_of
from stages.shared.formats.bvh_write import write_bvh
from stages.shared.formats.recording import Asked, recording_of
from stages.shared.formats.robot_csv import poses_of
from stages.shared.formats.robot_rig import RobotRig, robot_rig
from stages.shared.formats.robot_write import csv_of_rows, notes_of_rows, rows_of_motion
from stages.shared.formats.sources import source_named
from stages.shared.formats.urdf import looks_urdf

_STANDING = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)  # place and quaternion of a robot's root


@dataclass(frozen=True)
class Target:
    """The rig that a motion is put on.

    skeleton: its joints. poses: a motion of it, one frame of which becomes the reference pose.
    written:  the bytes of a motion of it in its own format, and notes on what they do not hold, one sentence each.
    suffix:   of files in that format.
    """

    skeleton: Skeleton
    poses: Motion
    written: Callable[[Motion], tuple[bytes, list[str]]]
    notes: list[str] = field(default_factory=list)
    suffix: str = ".bvh"


def read_target(config: Config) -> Target:
    """The rig of `config.to`. Raises InputError where it is none; UsageError for an output that it cannot give."""
    source = source_named(str(config.to))
    data = source.read()
    if looks_urdf(data):
        return _robot(robot_rig(data, source.name), config)
    if config.respect_limits:
        raise UsageError("--respect-limits is for robots, and --to names no URDF.", "Leave it out.")
    return target_of_bvh(read_bvh(data, source.name))


def target_of_bvh(bvh: BvhFile) -> Target:
    """The rig of a BVH, written with its header. Raises InputError where it is not a humanoid's."""
    skeleton, poses, notes = motion_of(bvh)

    def written(made: Motion) -> tuple[bytes, list[str]]:
        rows = values_of(bvh, skeleton, made)
        return write_bvh(bvh, rows, frame_count=made.frames, frame_time=1 / made.fps), []

    return Target(skeleton, poses, written, notes)


def _robot(robot: RobotRig, config: Config) -> Target:
    """A robot at zero angles, which is how it stands."""
    if config.respect_limits and config.output.suffix.lower() != ".csv":
        raise UsageError(
            f"--respect-limits is for a robot's joint angles, and {config.output.name} does not hold them.",
            "Name a .csv file.",
        )
    rows = np.array([[*_STANDING, *robot.hinges.within(np.zeros((1, len(robot.angle_names))))[0]]])
    standing = recording_of(robot.source, robot.source_rig(), poses_of(rows, robot, 30.0), Asked())

    def written(made: Motion) -> tuple[bytes, list[str]]:
        rows = rows_of_motion(robot, standing.skeleton, made, config.output.name, limited=config.respect_limits)
        return csv_of_rows(rows.values), notes_of_rows(robot, rows, limited=config.respect_limits)

    return Target(standing.skeleton, standing.motion, written, sentences_of(standing.notes), ".csv")
