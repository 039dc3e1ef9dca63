"""The motions of an artefact refined, each by the concepts of its own action."""

from __future__ import annotations

import numpy as np

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.errors import PumpsError, UsageError
from data_schemas.motion import MotionReader, MotionWriter
from stages.refine.config import Config
from stages.refine.page import page_of
from stages.refine.table import csv_of
from stages.shared.concepts.actions import action_of, action_pattern
from stages.shared.contract import StageReport
from stages.shared.inference.refined_motion import Refined, refined_motion
from stages.shared.inference.refining import ConceptModel
from stages.shared.outputs import write_output
from stages.shared.progress import Progress

_SHOWN = 12  # motions on the page, and reasons in the lines


def run_artefact(config: Config, model: ConceptModel, progress: Progress) -> StageReport:
    """Refine all clips of a motion artefact into another one. Clips that cannot be refined are left as they are.

    Raises: UsageError if no clip can be refined.
    """
    pattern = action_pattern(config.actions)
    weights = open_artefact(config.weights, "checkpoint")
    flawed_ones: list[tuple[str, str, Refined]] = []
    others: list[tuple[str, str, Refined]] = []
    rows, moved, left = [], [], []
    with (
        MotionReader(config.input) as reader,
        write_artefact(
            config.output, "motion", stage="refine", config=config, inputs=[reader.artefact, weights]
        ) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        progress.start("refining", len(reader.clips))
        for number, row in enumerate(reader.clips):
            skeleton, motion = reader.skeleton(row.skeleton), reader.motion(row.clip)
            writer.add_skeleton(skeleton)
            action = config.action or action_of(row, pattern)
            try:
                found = refined_motion(model, skeleton, motion, action, config.only, config.seed + number, row.clip)
            except PumpsError as error:
                left.append(f"{row.clip} is left as it is: {error}")
                writer.add_clip(row, motion)
            else:
                writer.add_clip(row, found.motion)
                rows += [{"clip": row.clip, "action": action, **each} for each in found.anchors(model.fps)]
                moved.append(found.moved_mm)
                kept = flawed_ones if found.found.flawed.any() else others
                if len(kept) < _SHOWN:
                    kept.append((row.clip, action, found))
            progress.advance(1, row.clip)
        if not moved:
            why = f"The first of {len(left)} reasons: {left[0]}" if left else "It holds none."
            raise UsageError(f"No clip of {config.input} was refined. {why}")
    if config.table is not None:
        write_output(config.table, csv_of(rows))
    if config.page is not None:
        write_output(config.page, page_of([*flawed_ones, *others][:_SHOWN], config, model.fps))
    flawed = sum(row["flawed"] for row in rows)
    mean_mm = float(np.mean(moved))
    return StageReport(
        output=config.output,
        lines=[
            f"{len(moved)} of {len(moved) + len(left)} motions were refined: {flawed} of {len(rows)} anchors were "
            f"judged flawed; joints moved by {mean_mm:.1f} mm (mean over motions).",
            *left[:_SHOWN],
        ],
        figures={
            "clips": len(moved), "left": len(left), "anchors": len(rows), "flawed": int(flawed), "moved_mm": mean_mm,
        },
    )  # fmt: skip
