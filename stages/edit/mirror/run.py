"""`pumps edit mirror`: left and right exchanged."""

from __future__ import annotations

import numpy as np

from stages.edit.mirror.config import Config
from stages.shared.contract import StageReport
from stages.shared.editing.edited import NONE, Edited
from stages.shared.editing.edited_file import Change, edit_file
from stages.shared.editing.mirror import mirror_of, mirrored
from stages.shared.editing.motion_files import MotionFile
from stages.shared.many_files.file_runs import over_files
from stages.shared.progress import SILENT, Progress


@over_files
def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Mirror a motion on its own skeleton.

    Raises: UsageError for options that are not possible; InputError for a bad file.
    """

    def change(file: MotionFile) -> Change:
        skeleton, motion = file.skeleton, file.motion
        mirror = mirror_of(skeleton, motion, config.across)
        none = np.full(motion.frames, NONE)
        edited = Edited.of(mirrored(skeleton, motion, mirror), none)
        pairs = [(joint, other) for joint, other in enumerate(mirror.partner.tolist()) if joint < other]
        alone = [name for joint, name in enumerate(file.skeleton.names) if mirror.partner[joint] == joint]
        lines = [
            f"Exchanged {len(pairs)} pairs of joints; {len(alone)} joints have no partner ({', '.join(alone[:6])}"
            f"{', ...' if len(alone) > 6 else ''})."
        ]
        names = [[skeleton.names[a], skeleton.names[b]] for a, b in pairs]
        return Change(edited, lines, {"pairs": names}, mirror=mirror)

    return edit_file(config, change, progress)
