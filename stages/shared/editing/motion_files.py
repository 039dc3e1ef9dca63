"""A file whose motion is edited, and the result in the file's own text."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from data_schemas.errors import InputError
from data_schemas.notes import sentences_of
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.editing.edited import NONE, Edited
from stages.shared.editing.mirror import Mirror
from stages.shared.editing.mirrored_rows import mirrored_columns, mirrored_text
from stages.shared.formats.bvh import BvhFile, read_bvh
from stages.shared.formats.bvh_motion import motion_of, rate_of
from stages.shared.formats.bvh_rows import values_of
from stages.shared.formats.bvh_write import with_frame_count, write_bvh
from stages.shared.formats.euler_rows import rows_between_keys, sentences_of_jumps
from stages.shared.formats.readers import read_recordings, recognise, rig_beside
from stages.shared.formats.recording import Asked
from stages.shared.formats.robot_csv import rig_asked
from stages.shared.formats.robot_rig import RobotRig
from stages.shared.formats.robot_table import RobotTable, read_table, table_with_rows
from stages.shared.formats.robot_write import notes_of_rows, rows_of_motion, spelled_as_keys
from stages.shared.formats.skeleton_map import choose_map
from stages.shared.formats.sources import Source
from stages.shared.formats.writers import bytes_of_motion, written_format


@dataclass(frozen=True)
class MotionFile:
    """A file's motion, with the text that a result of the same format keeps.

    bvh: the file, if it is a BVH. robot, table: the same of a robot's joint angles.
    """

    name: str
    skeleton: Skeleton
    motion: Motion
    notes: tuple[str, ...] = ()
    bvh: BvhFile | None = None
    robot: RobotRig | None = None
    table: RobotTable | None = None

    def keeps_text(self, output: Path) -> bool:
        """Whether a result with the output's suffix is written in this file's own text."""
        suffix = output.suffix.lower()
        return (self.bvh is not None and suffix == ".bvh") or (self.robot is not None and suffix == ".csv")

    def written(self, output: Path, edited: Edited, *, mirror: Mirror | None = None) -> tuple[bytes, list[str]]:
        """The edited motion as a file of the output's suffix, and notes on what that cannot hold.

        Args:
            mirror: what the whole motion was mirrored at. A BVH's numbers then keep their digits where they can.
        """
        suffix = output.suffix.lower()
        if self.bvh is not None and suffix == ".bvh":
            return _bvh_bytes(self.bvh, self.skeleton, edited, mirror)
        if self.robot is not None and self.table is not None and suffix == ".csv":
            return _robot_bytes(self.robot, self.table, self.skeleton, edited)
        return bytes_of_motion(written_format(output), self.skeleton, edited.motion, output.stem)

    def with_rows_of(self, other: MotionFile) -> MotionFile:
        """The file with the other's rows after its own, for a result that has frames of both.

        Raises: InputError if one of them keeps its text and the other one does not fit into it.
        """
        if self.bvh is not None:
            if other.bvh is None or [j.channels for j in self.bvh.joints] != [j.channels for j in other.bvh.joints]:
                raise InputError(
                    f"{other.name} has other channels than {self.name}, so its rows cannot stand in that file.",
                    f"Write {other.name} with its header first: pumps export {other.name} --rig {self.name}.",
                )
            values = np.concatenate([self.bvh.values, other.bvh.values])
            head = with_frame_count(self.bvh.motion_head, len(values))
            rows = [*self.bvh.rows, *other.bvh.rows]
            return replace(self, bvh=replace(self.bvh, values=values, rows=rows, motion_head=head))
        if self.table is not None:
            if other.table is None or len(other.table.columns) != len(self.table.columns):
                raise InputError(f"{other.name} does not hold the angles of the robot of {self.name}.")
            table = self.table
            values = np.concatenate([table.values, other.table.values])
            raw = np.concatenate([table.raw, np.zeros((other.table.frames, table.raw.shape[1]))])
            raw[len(table.raw) :, table.columns] = other.table.values
            lines = [*table.lines, *other.table.lines]
            return replace(self, table=replace(table, values=values, raw=raw, lines=lines))
        return self


def motion_file(source: Source, asked: Asked, data: bytes | None = None) -> MotionFile:
    """The one motion of a source, or of its bytes where they are at hand.

    Raises: InputError naming the file if it is no recording, or holds several clips.
    """
    data = source.read() if data is None else data
    name = source.name
    chosen = recognise(data, name)
    if chosen is None:
        raise InputError(
            f"{name} is not a recording in a format that pumps reads.", "docs/formats.md lists the formats."
        )
    if chosen.name == "robot" and not asked.rig_name:
        beside = rig_beside(source, chosen.rig)
        if beside is not None:
            asked = replace(asked, rig=beside.read(), rig_name=beside.name)
    if chosen.name == "bvh":
        bvh = read_bvh(data, name)
        skeleton, motion, oddities = motion_of(
            bvh, fps_override=asked.fps_override, skeleton_maps=asked.skeleton_maps, up_axis=asked.up_axis
        )
        choose_map(asked.skeleton_maps, skeleton.names, must_fit=bool(asked.skeleton_maps))
        return MotionFile(name, skeleton, motion, tuple(oddities), bvh)
    found = read_recordings(data, source, chosen, asked)
    if len(found) != 1:
        raise InputError(
            f"{name} holds {len(found)} clips, and one is edited at a time.",
            "Export them first: pumps export FILE --format bvh -o FOLDER.",
        )
    each = found[0]
    choose_map(asked.skeleton_maps, each.skeleton.names, must_fit=bool(asked.skeleton_maps))
    notes = tuple(sentences_of([*each.notes, *each.remarks]))
    if chosen.name != "robot":
        return MotionFile(name, each.skeleton, each.motion, notes)
    robot = rig_asked(name, asked)
    return MotionFile(name, each.skeleton, each.motion, notes, None, robot, read_table(data, name, robot))


def _bvh_bytes(bvh: BvhFile, skeleton: Skeleton, edited: Edited, mirror: Mirror | None) -> tuple[bytes, list[str]]:
    motion = edited.motion
    stated = abs(motion.fps - rate_of(bvh.frame_time)) < 1e-9 * motion.fps
    frame_time = None if stated else 1.0 / motion.fps
    near = np.full((motion.frames, bvh.values.shape[1]), np.nan)
    near[edited.like >= 0] = bvh.values[edited.like[edited.like >= 0]]
    if mirror is not None:
        columns = mirrored_columns(bvh, skeleton, mirror, set(motion.track_joints.tolist()))
        values = values_of(bvh, skeleton, motion, near)
        text = mirrored_text(bvh, columns, values)
        every = {frame: frame for frame in range(motion.frames)}
        return write_bvh(text, text.values, every, frame_time=frame_time), []
    out = near.copy()
    made = np.flatnonzero((edited.rows == NONE) & ~edited.bridged)
    if len(made):
        own = np.flatnonzero(edited.placed)
        columns = slice(len(bvh.joints[0].channels), None)  # all but joint 0's
        guide = near.copy()
        guide[own, : columns.start] = np.nan  # turned by up to half a turn, it goes on from the frame before
        out[made] = values_of(bvh, skeleton, motion.at(made), guide[made])
        out[own, columns] = near[own, columns]
    jumps: list[str] = []
    if edited.bridged.any():
        known = np.flatnonzero(~edited.bridged)
        out, found = rows_between_keys(bvh, skeleton, motion, known, out[known])
        jumps = sentences_of_jumps(found, 0)
    return write_bvh(bvh, out, edited.kept, motion.frames, frame_time=frame_time), jumps


def _robot_bytes(robot: RobotRig, table: RobotTable, skeleton: Skeleton, edited: Edited) -> tuple[bytes, list[str]]:
    """Rows of a robot's angles, with the whole turns and the quaternion's sign of the rows that they are like."""
    motion = edited.motion
    made = rows_of_motion(robot, skeleton, motion, table.name)
    guided, values = np.flatnonzero(edited.like >= 0), made.values
    if len(guided):
        values = spelled_as_keys(values, guided, table.values[edited.like[guided]])
    kept = edited.kept
    data = table_with_rows(table, values, kept, kept or {0: 0, motion.frames - 1: table.frames - 1})
    return data, notes_of_rows(robot, made, limited=False)
