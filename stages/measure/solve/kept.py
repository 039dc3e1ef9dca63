"""The motions of a measurement, kept as artefacts to be played side by side (`pumps report --motions`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from data_schemas.artefact import write_artefact
from data_schemas.clips import ClipRow
from data_schemas.manifest import Artefact
from data_schemas.motion import MotionReader, MotionWriter
from data_schemas.skeleton import Motion
from stages.measure.solve.conditions import Condition, shortened
from stages.measure.solve.config import Config
from stages.measure.solve.draws import rng_of
from stages.measure.solve.methods import Method
from stages.measure.solve.rigs import Rigged
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.resampling import resample

TRUTH = "truth"


def keep_motions(
    reader: MotionReader,
    clips: Mapping[str, Sequence[ClipRow]],
    condition: Condition,
    methods: Sequence[Method],
    config: Config,
    folder: Path,
    inputs: Sequence[Artefact],
) -> list[Path]:
    """Write FOLDER/ARCHIVE/METHOD, a motion artefact each, and FOLDER/ARCHIVE/truth; what was written.

    A method that cannot move an archive's rig has no artefact there. Spaces in names become dashes, since `make`
    would read such a name as two files.
    """
    written = []
    for archive, rows in clips.items():
        made: dict[str, list[tuple[ClipRow, Motion]]] = {}
        for row in rows:
            motion = shortened(resample(reader.motion(row.clip), MODEL_FPS), config.condition_seconds)
            case = condition.make(Rigged(reader.skeleton(row.skeleton), motion), rng_of(config.seed, row))
            kept = replace(row, frames=motion.frames, fps=motion.fps, seconds=motion.frames / motion.fps)
            made.setdefault(TRUTH, []).append((kept, motion))
            for method in methods:
                found = method.make(case)
                if found is not None:
                    made.setdefault(method.name, []).append((kept, found))
        for name, motions in made.items():
            if len(motions) == len(rows):
                written.append(_write(reader, motions, folder / archive / name.replace(" ", "-"), config, inputs))
    return written


def _write(
    reader: MotionReader,
    motions: Sequence[tuple[ClipRow, Motion]],
    path: Path,
    config: Config,
    inputs: Sequence[Artefact],
) -> Path:
    with (
        write_artefact(path, "motion", stage="measure-solve", config=config, inputs=inputs) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        for row, motion in motions:
            name = writer.add_skeleton(reader.skeleton(row.skeleton))
            writer.add_clip(replace(row, skeleton=name), motion)
        draft.summary.update(clips=len(motions))
    return path
