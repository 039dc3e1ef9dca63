"""`pumps edit loop`: a clip that can be repeated."""

from __future__ import annotations

from dataclasses import replace

from stages.edit.loop.config import Config
from stages.shared.contract import StageReport
from stages.shared.editing.bridging import looped
from stages.shared.editing.edited_file import Change, change_of_bridge, edit_file, trip_of
from stages.shared.editing.motion_files import MotionFile
from stages.shared.inference.kept_models import kept_models
from stages.shared.many_files.file_runs import over_files
from stages.shared.progress import SILENT, Progress


@over_files
def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Add frames that lead from the last pose to the first one, moved and turned as the clip moves and turns.

    Raises: UsageError for options that are not possible; InputError for a bad file.
    """

    def change(file: MotionFile) -> Change:
        found = looped(
            file.skeleton, file.motion, lambda: kept_models(config.weights, config.device),
            seconds=config.blend, seed=config.seed,
        )  # fmt: skip
        made = change_of_bridge(found, file.motion.fps, "from the last pose to the first one, at its new place")
        trip, turn = trip_of(made)
        lines = [*made.lines, f"Every repetition moves by {trip:.3f} m and turns by {turn:.1f} degrees."]
        return replace(made, lines=lines)

    return edit_file(config, change, progress)
