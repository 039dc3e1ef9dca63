"""The two kinds of file that are filled, a BVH and a robot's joint angles: a head and rows, kept as they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Protocol

import numpy as np

from data_schemas.errors import InputError, UsageError
from data_schemas.notes import sentences_of
from data_schemas.skeleton import Motion, Skeleton
from stages.infill.config import Config
from stages.infill.part_rows import columns_given, rows_between_parts, values_given
from stages.shared.formats.bvh import BvhFile, read_bvh
from stages.shared.formats.bvh_motion import motion_of, rate_of
from stages.shared.formats.bvh_write import write_bvh
from stages.shared.formats.euler_rows import rows_between_keys, sentences_of_jumps
from stages.shared.formats.readers import recognise, rig_beside
from stages.shared.formats.recording import Asked, recording_of
from stages.shared.formats.rig_option import rig_named
from stages.shared.formats.robot_csv import USUAL_FPS, poses_of, rig_asked
from stages.shared.formats.robot_rig import RobotRig
from stages.shared.formats.robot_table import RobotTable, check_rows, read_table, table_with_rows
from stages.shared.formats.robot_write import RobotRows, notes_of_rows, rows_of_motion, spelled_as_keys
from stages.shared.formats.skeleton_map import SkeletonMap, choose_map
from stages.shared.formats.sources import Source
from stages.shared.inference.constraints.known_parts import KnownParts


class RowFile(Protocol):
    """A file of T rows, some of them keyframes.

    frames: T. fps: frames a second, as the file or the user states. suffix: of such files, lower case.
    """

    frames: int
    fps: float
    suffix: str

    def motion_in(self, data: bytes) -> tuple[Skeleton, Motion]:
        """The whole motion of a file that `written` made."""
        ...

    def key_motion(self, rows: np.ndarray, maps: tuple[SkeletonMap, ...]) -> tuple[Skeleton, Motion, list[str]]:
        """The skeleton, the motion of the rows (K,) of keyframes alone, and notes on them.

        Raises: InputError where such a row is not a pose.
        """
        ...

    def part_motion(self, parts: KnownParts, maps: tuple[SkeletonMap, ...]) -> tuple[Skeleton, Motion, list[str]]:
        """As `key_motion`, of the rows of which something is given. In the other rows, and in what is not given, the
        motion means nothing.

        Args:
            parts: what is given of the first rows; further ones are not in the file.
        """
        ...

    def written(
        self,
        filled: Motion,
        first: int,
        keys: np.ndarray,
        rows: np.ndarray,
        kept: Mapping[int, int],
        frames: int,
        parts: KnownParts | None = None,
    ) -> tuple[bytes, list[str]]:
        """The file's bytes with what was filled, and notes on what it cannot hold.

        Args:
            filled: of the output's frames from `first` on. keys, rows: (K,) frames of the output that are given, the
                first of them `first`, and the file's rows of them.
            kept: frame of the output -> row that is copied byte for byte.
            frames: how many the output has.
            parts: what is given of each frame of the output beside keys: its columns are copied byte for byte.
        """
        ...


def row_file(source: Source, config: Config, data: bytes | None = None) -> RowFile:
    """A source, or its bytes where they are at hand, as a file of rows.

    Raises: InputError where it holds none; UsageError for options of the other kind of file.
    """
    data, name = source.read() if data is None else data, source.name
    sparse = config.times is not None or config.frames is not None
    chosen = recognise(data, name)
    if source.suffix == ".csv" or (chosen is not None and chosen.name == "robot"):
        if config.up_axis is not None:
            raise UsageError(
                f"--up-axis is for a BVH, and {name} holds a robot's angles, which are Z up.", "Leave it out."
            )
        return _RobotRows(data, source, config, keep=not sparse)
    if config.skeleton is not None or config.respect_limits:
        option = "--skeleton" if config.skeleton is not None else "--respect-limits"
        raise UsageError(f"{option} is for a robot's joint angles, and {name} holds its skeleton.", "Leave it out.")
    return _BvhRows(read_bvh(data, name, keep_unreadable_rows=not sparse), config)


class _BvhRows:
    suffix = ".bvh"

    def __init__(self, bvh: BvhFile, config: Config) -> None:
        self.bvh, self._override, self._up_axis = bvh, config.fps_override, config.up_axis
        self.frames = bvh.frames
        self.fps = self._override or rate_of(bvh.frame_time)
        self._skeleton: Skeleton | None = None
        self._given_values: np.ndarray | None = None

    def motion_in(self, data: bytes) -> tuple[Skeleton, Motion]:
        bvh = read_bvh(data, self.bvh.name)
        skeleton, motion, _ = motion_of(bvh, fps_override=self._override, up_axis=self._up_axis)
        return skeleton, motion

    def key_motion(self, rows: np.ndarray, maps: tuple[SkeletonMap, ...]) -> tuple[Skeleton, Motion, list[str]]:
        key_file = self.bvh.select(rows)
        bad = np.flatnonzero(~np.isfinite(key_file.values).all(axis=1))
        if len(bad):
            raise InputError(
                f"{self.bvh.name}: row {rows[bad[0]]}, a keyframe, does not hold {key_file.values.shape[1]} numbers.",
                "Mend the row or leave it out of the keyframes.",
            )
        choose_map(maps, [joint.name for joint in self.bvh.joints], must_fit=bool(maps))
        self._skeleton, motion, notes = motion_of(
            key_file, fps_override=self._override, skeleton_maps=maps, up_axis=self._up_axis
        )
        return self._skeleton, motion, notes

    def part_motion(self, parts: KnownParts, maps: tuple[SkeletonMap, ...]) -> tuple[Skeleton, Motion, list[str]]:
        assert self._skeleton is not None  # what parts are is known from a rig
        self._given_values = values_given(self.bvh, parts.rows(slice(self.frames)), self._skeleton)
        self._skeleton, motion, notes = motion_of(
            replace(self.bvh, values=self._given_values),
            fps_override=self._override, skeleton_maps=maps, up_axis=self._up_axis,
        )  # fmt: skip
        return self._skeleton, motion, notes

    def written(
        self,
        filled: Motion,
        first: int,
        keys: np.ndarray,
        rows: np.ndarray,
        kept: Mapping[int, int],
        frames: int,
        parts: KnownParts | None = None,
    ) -> tuple[bytes, list[str]]:
        assert self._skeleton is not None  # made with the keys' motion
        key_values = self.bvh.values[rows]
        region = slice(first, first + filled.frames)
        copied = None
        if parts is None:
            made, jumps = rows_between_keys(self.bvh, self._skeleton, filled, keys - first, key_values)
        else:
            assert self._given_values is not None  # made with the parts' motion
            given = columns_given(self.bvh, parts, self._skeleton)
            made, jumps = rows_between_parts(
                self.bvh, self._skeleton, filled, given[region], self._given_values[first : region.stop]
            )
            copied = {row: given[row] for row in range(self.frames) if row not in kept and given[row].any()}
        values = made
        if len(made) < frames:
            values = np.zeros((frames, key_values.shape[1]))
            values[region] = made
        # The file's own text of the frame time stays, unless the user says that it is wrong.
        stated = self._override is None or self._override == rate_of(self.bvh.frame_time)
        frame_time = None if stated else 1.0 / self.fps
        data = write_bvh(self.bvh, values, kept, frames, frame_time=frame_time, verbatim_columns=copied)
        return data, sentences_of_jumps(jumps, first)


class _RobotRows:
    suffix = ".csv"

    def __init__(self, data: bytes, source: Source, config: Config, *, keep: bool) -> None:
        name = source.name
        rig, rig_name = rig_named(config.skeleton) if config.skeleton is not None else (b"", "")
        beside = rig_beside(source, ".urdf") if not rig_name else None
        if beside is not None:
            rig, rig_name = beside.read(), beside.name
        self.robot: RobotRig = rig_asked(name, Asked(rig=rig, rig_name=rig_name))
        self.table: RobotTable = read_table(data, name, self.robot, keep_unreadable_rows=keep)
        self.frames = self.table.frames
        self.fps = config.fps_override or USUAL_FPS
        self.limited = config.respect_limits
        self._notes = (
            [] if config.fps_override else [f"{name} states no frame rate; taken as {USUAL_FPS:g} a second."]
        )
        self._skeleton: Skeleton | None = None

    def motion_in(self, data: bytes) -> tuple[Skeleton, Motion]:
        table = read_table(data, self.table.name, self.robot)
        poses = poses_of(table.values, self.robot, self.fps)
        recording = recording_of(self.table.name, self.robot.source_rig(), poses, Asked())
        return recording.skeleton, recording.motion

    def key_motion(self, rows: np.ndarray, maps: tuple[SkeletonMap, ...]) -> tuple[Skeleton, Motion, list[str]]:
        check_rows(self.table, self.robot, rows)
        choose_map(maps, self.robot.names, must_fit=bool(maps))
        poses = poses_of(self.table.values[rows], self.robot, self.fps)
        recording = recording_of(self.table.name, self.robot.source_rig(), poses, Asked(skeleton_maps=maps))
        self._skeleton = recording.skeleton
        return recording.skeleton, recording.motion, [*self._notes, *sentences_of(recording.notes)]

    def part_motion(self, parts: KnownParts, maps: tuple[SkeletonMap, ...]) -> tuple[Skeleton, Motion, list[str]]:
        raise InputError("Parts of frames can be given in a BVH alone.", "Give whole keyframes.")

    def written(
        self,
        filled: Motion,
        first: int,
        keys: np.ndarray,
        rows: np.ndarray,
        kept: Mapping[int, int],
        frames: int,
        parts: KnownParts | None = None,
    ) -> tuple[bytes, list[str]]:
        assert self._skeleton is not None and parts is None  # made with the keys' motion
        key_values = self.table.values[rows]
        made = rows_of_motion(self.robot, self._skeleton, filled, self.table.name, limited=self.limited)
        at = keys - first
        values = np.zeros((frames, key_values.shape[1]))
        values[first : first + filled.frames] = spelled_as_keys(made.values, at, key_values)
        missing = np.setdiff1d(np.arange(first, first + filled.frames), np.fromiter(kept, np.int64)) - first
        shown = RobotRows(values, made.beyond[missing], made.off_m[missing], made.fitted[missing])
        by_frame = dict(zip(keys.tolist(), rows.tolist(), strict=True))
        text = table_with_rows(self.table, values, kept, by_frame)
        return text, notes_of_rows(self.robot, shown, limited=self.limited)
