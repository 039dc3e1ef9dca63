"""Joint angles of a robot as text (Unitree's and many others' layout), on the skeleton of its URDF.

A line per frame: the root's place x, y, z in metres, Z up; its rotation as a quaternion x, y, z, w; then the angle of
every joint that turns, in radians, in the URDF's order or in the order of a first line of column names.
"""

from __future__ import annotations

import numpy as np

from data_schemas.errors import InputError
from data_schemas.notes import Flag, Note, note
from stages.shared.formats.recording import Asked, Recording, check_room, recording_of
from stages.shared.formats.robot_rig import FROM_ROBOT, RobotRig, robot_rig
from stages.shared.formats.robot_table import read_table
from stages.shared.formats.source_body import SourcePoses
from stages.shared.formats.urdf import looks_urdf

USUAL_FPS = 30.0


def read_robot_csv(data: bytes, name: str, asked: Asked) -> list[Recording]:
    """The one clip of a robot's joint angles, on the URDF `asked.rig`. Raises InputError naming line and column."""
    rig = rig_asked(name, asked)
    table = read_table(data, name, rig)
    check_room(name, len(data), len(table.values), len(rig.names))
    notes: list[Note] = []
    if _written_w_first(table.values[:, 3:7]):
        notes.append(note(Flag.UPSIDE_DOWN))
    remarks = []
    fps = asked.fps_override
    if fps is None:
        fps = USUAL_FPS
        remarks.append(note(Flag.NO_FRAME_RATE, fps=USUAL_FPS))
    return [
        recording_of(name, rig.source_rig(), poses_of(table.values, rig, fps), asked, notes=notes, remarks=remarks)
    ]


def rig_asked(name: str, asked: Asked) -> RobotRig:
    """The robot of a file's angles. Raises InputError if no URDF was given."""
    if not looks_urdf(asked.rig):
        given = f"{asked.rig_name} is not a URDF" if asked.rig_name else "no URDF lies beside it"
        raise InputError(
            f"{name} holds angles of joints and no skeleton: {given}.",
            "Give the robot's URDF with --skeleton robot.urdf ('archive.zip!robot.urdf' too).",
        )
    return robot_rig(asked.rig, asked.rig_name)


def poses_of(values: np.ndarray, rig: RobotRig, fps: float) -> SourcePoses:
    """The poses of rows, in the axes of a skeleton (Y up).

    Args:
        values: (T, 7 + M) rows of a RobotTable.
    """
    local = rig.hinges.local_rotations(values[:, 7:])
    root = values[:, 3:7][:, (*FROM_ROBOT, 3)]
    local[:, 0] = root / np.linalg.norm(root, axis=1, keepdims=True)
    return SourcePoses(local, values[:, :3][:, FROM_ROBOT].copy(), fps)


def _written_w_first(quaternions: np.ndarray) -> bool:
    """Whether, in most frames, the root is upside down if read as x y z w and upright if read as w x y z."""
    x, y, z, w = quaternions.T
    as_read = np.median(1 - 2 * (x * x + y * y))
    w_first = np.median(1 - 2 * (y * y + z * z))
    return bool(as_read < -0.5 and w_first > 0.5) and abs(float(np.median(w))) < 0.5
