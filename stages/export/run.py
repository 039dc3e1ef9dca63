"""`pumps export`: clips in the forms that other programs read."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

from data_schemas.errors import InputError, UsageError
from stages.export.clips import Clip, clips_of, names_of
from stages.export.config import Config
from stages.export.other_rig import bvh_on_rig
from stages.shared.contract import StageReport
from stages.shared.file_names import FileNames
from stages.shared.formats.robot_rig import robot_named
from stages.shared.formats.robot_write import csv_of_rows, notes_of_rows, rows_of_motion
from stages.shared.formats.writers import SUFFIXES, bytes_of_motion, written_format
from stages.shared.many_files.file_runs import over_files
from stages.shared.outputs import check_file, check_replaceable, check_written, write_output
from stages.shared.progress import SILENT, Progress

_SUFFIXES = {**SUFFIXES, "robot-csv": ".csv"}


@over_files
def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Write one clip to a file, or every clip to a folder; of several recordings, one file each.

    Raises: UsageError where it is not said what to write; InputError where the input is none, has no such clip, or
        the rig does not correspond.
    """
    into_folder = config.output.is_dir() or not config.output.suffix
    kind = _kind_of(config, into_folder)
    names = names_of(config)
    files = FileNames()

    def path_of(name: str) -> Path:
        return config.output / f"{files.of(name)}{_SUFFIXES[kind]}" if into_folder else config.output

    folder = config.body_models
    models = [("body-models", each) for each in folder.iterdir()] if folder and folder.is_dir() else []

    def check(path: Path) -> None:
        check_written(config, path)
        check_replaceable(path, config.overwrite, models)

    if not into_folder:
        check_file(config)
        check(config.output)
    for name in names or ():
        check(path_of(name))
    progress.start("Writing clips", len(names) if names else None)
    written: list[Path] = []
    frames = 0
    notes: list[str] = []
    for clip in clips_of(config) if into_folder else _only_one(config):
        path = path_of(clip.name)
        check(path)
        data, remarks = _data_of(clip, kind, config)
        write_output(path, data)
        written.append(path)
        frames += clip.motion.frames
        if into_folder and path.name != f"{clip.name}{_SUFFIXES[kind]}":
            remarks = [
                *remarks,
                f"Its file is {path.name}, since the clip's name cannot be a file name or is taken.",
            ]
        notes += [f"{clip.name}: {note}" for note in (*clip.notes, *remarks)]
        progress.advance(1, clip.name)
    if not written:
        raise InputError(f"{config.input} holds no clip.")
    where = str(written[0]) if len(written) == 1 else f"{len(written)} files into {config.output}"
    return StageReport(
        output=config.output,
        lines=[f"wrote {where}", *dict.fromkeys(notes)],
        figures={"format": kind, "files": [str(path) for path in written], "frames": frames, "notes": notes},
    )


def _only_one(config: Config) -> list[Clip]:
    clips = list(islice(clips_of(config), 2))
    if len(clips) > 1:
        raise UsageError(f"{config.input} holds several clips.", "Name one with --clip, or a folder to write to.")
    return clips


def _kind_of(config: Config, into_folder: bool) -> str:
    if config.format != "auto":
        kind = config.format
    elif into_folder:
        raise UsageError(f"{config.output} is a folder, so it is not said what to write.", "Give --format.")
    else:
        kind = written_format(config.output)
        if kind == "csv" and (config.rig or "").lower().endswith(".urdf"):
            kind = "robot-csv"
    if config.rig is not None and kind not in ("bvh", "robot-csv"):
        raise UsageError(f"--rig is for BVH and robot-csv, and {kind} is to be written.", "Leave it out.")
    if config.respect_limits and kind != "robot-csv":
        raise UsageError(f"--respect-limits is for robot-csv, and {kind} is to be written.", "Leave it out.")
    if kind == "robot-csv" and not (config.rig or config.skeleton):
        raise UsageError("It is not said which robot's angles to write.", "Give its URDF: --rig robot.urdf.")
    return kind


def _data_of(clip: Clip, kind: str, config: Config) -> tuple[bytes, list[str]]:
    """The file's bytes, and what it does not tell of the clip."""
    skeleton, motion = clip.skeleton, clip.motion
    if kind == "bvh" and config.rig is not None:
        return bvh_on_rig(skeleton, motion, config.rig, clip.name)
    if kind == "robot-csv":
        robot = robot_named(str(config.rig or config.skeleton))
        rows = rows_of_motion(robot, skeleton, motion, clip.name, limited=config.respect_limits)
        return csv_of_rows(rows.values), notes_of_rows(robot, rows, limited=config.respect_limits)
    return bytes_of_motion(kind, skeleton, motion, clip.name, licence=clip.licence, values=config.values)
