"""`pumps data rerig`: motions that a network may know, on skeletons that it does not."""

from __future__ import annotations

from dataclasses import replace

from data_schemas.artefact import write_artefact
from data_schemas.clip_filter import clips_where
from data_schemas.errors import InputError
from data_schemas.manifest import open_artefact
from data_schemas.motion import MotionReader, MotionWriter
from data_schemas.quality import MotionQuality
from stages.data.rerig.config import Config
from stages.shared.contract import StageReport
from stages.shared.humanoid.other_rigs import on_another_rig, rigs_of
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Write every clip of the splits once, on a rig drawn for it, as CLIP@RIG.

    Clips of more than `longest` frames are cut to that length.

    Sources and splits stay, so that results are listed by the recordings they came from.
    Raises: InputError where there is no such clip, or none could be put on a rig; UsageError for a bad expression.
    """
    check_artefact(config, "motion")
    artefacts = [open_artefact(path, "motion") for path in (config.motion, config.rigs)]
    with (
        MotionReader(artefacts[0]) as reader,
        MotionReader(artefacts[1]) as lender,
        write_artefact(config.output, "motion", stage="data-rerig", config=config, inputs=artefacts) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        rows = [row for row in clips_where(reader.clips, config.where) if row.split in config.splits]
        if not rows:
            raise InputError(
                f"{config.motion} has no such clip in the split {' or '.join(config.splits)}.",
                "Name others with --splits or --where.",
            )
        rigs = rigs_of(lender, lender.clips)
        for skeleton in rigs.skeletons.values():
            writer.add_skeleton(skeleton)
        progress.start("Putting clips on other rigs", len(rows))
        carried = 0
        for row in rows:
            whole = reader.motion(row.clip)
            longest = config.longest or whole.frames
            for moved, motion in on_another_rig(reader, row, whole, rigs, config.seed, longest=longest):
                own = replace(
                    moved, frames=motion.frames, seconds=motion.frames / motion.fps, flags="", quality=MotionQuality()
                )
                writer.add_clip(own, motion)
                carried += 1
            progress.advance(1, row.clip)
        if not carried:
            raise InputError(
                f"No clip of {config.motion} could be put on a rig of {config.rigs}.",
                "Both must be humanoids; `pumps inspect FILE` shows what is found of a rig.",
            )
        draft.summary |= {"clips": carried, "rigs": len(rigs.skeletons)}
    count = f"{len(rigs.skeletons)} rig{'' if len(rigs.skeletons) == 1 else 's'}"
    left = "" if carried == len(rows) else "; the others lack a limb, or have no pose in common with them"
    return StageReport(
        output=config.output,
        lines=[f"{carried} of {len(rows)} clips put on {count}{left}."],
        figures={"clips": carried, "asked": len(rows), "rigs": len(rigs.skeletons)},
    )
