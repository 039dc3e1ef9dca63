"""`pumps edit smooth`: a whole motion averaged in time."""

from __future__ import annotations

import numpy as np

from stages.edit.smooth.config import Config
from stages.shared.contract import StageReport
from stages.shared.editing.edited_file import Change, edit_file
from stages.shared.editing.motion_files import MotionFile
from stages.shared.editing.smooth import smoothed
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.many_files.file_runs import over_files
from stages.shared.progress import SILENT, Progress


@over_files
def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Smooth a motion; its first and last frame stay.

    Raises: UsageError for options that are not possible; InputError for a bad file.
    """

    def change(file: MotionFile) -> Change:
        skeleton, motion = file.skeleton, file.motion
        edited = smoothed(skeleton, motion, config.seconds, method=config.method)
        apart = np.linalg.norm(positions_of(skeleton, edited.motion) - positions_of(skeleton, motion), axis=-1)
        most = np.unravel_index(int(apart.argmax()), apart.shape)
        lines = [
            f"Joints moved by {apart.mean() * 1000:.1f} mm on average, and by {apart.max() * 1000:.0f} mm at most "
            f"({skeleton.names[int(most[1])]} in frame {int(most[0])})."
        ]
        return Change(edited, lines, {"moved_m": float(apart.mean()), "most_moved_m": float(apart.max())})

    return edit_file(config, change, progress)
