"""`pumps edit trim`: keep a range of frames."""

from __future__ import annotations

from data_schemas.errors import UsageError
from stages.edit.trim.config import Config
from stages.shared.contract import StageReport
from stages.shared.editing.edited_file import Change, edit_file
from stages.shared.editing.motion_files import MotionFile
from stages.shared.editing.timing import range_of_frames, range_of_seconds, trimmed
from stages.shared.many_files.file_runs import over_files
from stages.shared.progress import SILENT, Progress


@over_files
def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Cut a file to a range of its frames.

    Raises: UsageError for options that are not possible; InputError for a bad file.
    """
    if (config.frames is None) == (config.seconds is None):
        raise UsageError(
            "Exactly one of --frames and --seconds says what to keep.", "Give --frames 10:50, or --seconds 0.5:2."
        )

    def change(file: MotionFile) -> Change:
        motion = file.motion
        if config.frames is not None:
            kept = range_of_frames(config.frames, motion.frames)
        else:
            kept = range_of_seconds(config.seconds or "", motion.frames, motion.fps)
        return Change(trimmed(motion, kept), [f"Kept frames {kept[0]} to {kept[-1]}."])

    return edit_file(config, change, progress)
