"""`pumps edit join`: two clips, one after the other."""

from __future__ import annotations

from dataclasses import replace

from stages.edit.join.config import Config
from stages.shared.contract import StageReport
from stages.shared.editing.bridging import check_one_rig, joined
from stages.shared.editing.edited_file import Change, change_of_bridge, edit_file, file_asked, trip_of
from stages.shared.editing.motion_files import MotionFile
from stages.shared.inference.kept_models import kept_models
from stages.shared.progress import SILENT, Progress


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Join two clips of one rig: the second goes on where the first ends, and the frames between are filled.

    Raises: UsageError for options that are not possible; InputError for a bad file.
    """

    def change(file: MotionFile) -> Change:
        other = file_asked(config, config.then)
        check_one_rig(file.skeleton, other.skeleton, (file.name, other.name))
        text = file.with_rows_of(other) if file.keeps_text(config.output) else file
        found = joined(
            file.skeleton, file.motion, other.motion, lambda: kept_models(config.weights, config.device),
            seconds=config.blend, seed=config.seed,
        )  # fmt: skip
        theirs = (f"{other.name}: {note}" for note in other.notes)
        found = replace(found, edited=replace(found.edited, notes=(*theirs, *found.edited.notes)))
        made = change_of_bridge(found, file.motion.fps, "between the two clips", text)
        trip, turn = trip_of(made)
        lines = [
            *made.lines,
            f"{other.name} was turned by {turn:.1f} degrees and moved by {trip:.3f} m.",
        ]
        return replace(made, lines=lines, figures={**made.figures, "joined_frames": other.motion.frames})

    return edit_file(config, change, progress)
