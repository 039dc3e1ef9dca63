"""`pumps edit resample`: another frame rate."""

from __future__ import annotations

from dataclasses import replace

from stages.edit.resample.config import Config
from stages.shared.contract import StageReport
from stages.shared.editing.edited_file import Change, edit_file
from stages.shared.editing.motion_files import MotionFile
from stages.shared.editing.timing import resampled
from stages.shared.many_files.file_runs import over_files
from stages.shared.progress import SILENT, Progress


@over_files
def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Resample a file; poses at times that both rates share stay as they are.

    Raises: UsageError for options that are not possible; InputError for a bad file.
    """

    def change(file: MotionFile) -> Change:
        edited = resampled(file.skeleton, file.motion, config.fps)
        notes = edited.notes
        if file.table is not None and config.output.suffix.lower() == ".csv":
            notes = (
                *notes,
                f"A table of joint angles states no frame rate: read the output with --fps-override {config.fps:g}.",
            )
        return Change(replace(edited, notes=notes))

    return edit_file(config, change, progress)
