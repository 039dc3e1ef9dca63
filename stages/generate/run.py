"""`pumps generate` makes motions of actions with a trained generator."""

from __future__ import annotations

import time

from data_schemas.artefact import write_artefact
from data_schemas.motion import ClipRow, MotionWriter
from stages.generate.config import Config
from stages.shared.concepts.actions import generated_source
from stages.shared.contract import StageReport
from stages.shared.file_names import FileNames
from stages.shared.inference.generating import generated_motions, load_generator
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Generate and write a `motion` artefact. A clip's source names its action, and its split is `test`.

    Raises: UsageError for an action that was not learned; InputError for another checkpoint.
    """
    started = time.perf_counter()
    check_artefact(config, "motion")
    model = load_generator(config.weights, config.device)
    actions = list(dict.fromkeys(config.action or model.actions))
    clips = len(actions) * config.count
    for action in actions:
        model.action(action)
    progress.start("generating", clips)
    manifest, names = model.artefact.manifest, FileNames()
    with (
        write_artefact(config.output, "motion", stage="generate", config=config, inputs=[model.artefact]) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        skeleton = writer.add_skeleton(model.skeleton)
        for action in actions:
            made = generated_motions(model, action, config.count, config.frames, config.seed)
            for number, motion in enumerate(made):
                source = generated_source(action, number)
                row = ClipRow(
                    clip=names.of(source), source=source, sha256=manifest.digest, skeleton=skeleton,
                    frames=motion.frames, fps=motion.fps, seconds=motion.frames / motion.fps, split="test",
                    licence="; ".join(manifest.licences),
                )  # fmt: skip
                writer.add_clip(row, motion)
                progress.advance(1, source)
    seconds = time.perf_counter() - started
    return StageReport(
        output=config.output,
        lines=[f"Generated {clips} motions of {len(actions)} actions in {seconds:.1f} s."],
        figures={"clips": clips, "actions": actions, "seconds": seconds},
    )
