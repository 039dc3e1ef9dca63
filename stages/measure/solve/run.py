"""`pumps measure solve`: follow good and bad clouds whose motion is known, and measure the result."""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.clips import ClipRow
from data_schemas.errors import InputError
from data_schemas.manifest import open_artefact
from data_schemas.metrics import MetricRow, write_metrics
from data_schemas.motion import MotionReader
from stages.measure.solve.conditions import TRUE, Case, Condition, conditions_of, shortened
from stages.measure.solve.config import Config
from stages.measure.solve.draws import rng_of
from stages.measure.solve.kept import TRUTH, keep_motions
from stages.measure.solve.measurements import measurements_of, skate_mps
from stages.measure.solve.methods import Method, methods_of
from stages.measure.solve.rigs import Rigged
from stages.measure.solve.summary import summary_md, terminal_lines
from stages.shared.contract import StageReport
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.forward import positions_of
from stages.shared.kinematics.resampling import resample, resampled_frames
from stages.shared.outputs import check_artefact, check_folder
from stages.shared.progress import SILENT, Progress
from stages.shared.statistics.archives import archive_of
from stages.shared.statistics.windows import LEAST_FRAMES


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Measure and write a `metrics` artefact.

    Raises:
        InputError: the motion artefact is bad or has no clip of these splits that is long enough.
        UsageError: two networks have the same name.
    """
    check_artefact(config, "metrics")
    if config.made is not None:
        check_folder(config, "made")
    artefact = open_artefact(config.motion, "motion")
    methods, conditions = methods_of(config), conditions_of(config)
    sources = dict.fromkeys(method.source for method in methods if method.source)
    inputs = [artefact, *(open_artefact(source, "checkpoint") for source in sources)]
    rows: list[MetricRow] = []
    pace = _Pace()
    with MotionReader(artefact) as reader:
        clips = chosen_clips(reader, config)
        some = {archive: spread(of, config.condition_clips) for archive, of in clips.items()}
        plan = [(c, row) for c in conditions for of in (clips if c.name == TRUE else some).values() for row in of]
        progress.start("Following clouds", len(plan))
        for condition, row in plan:
            rows += _measured(reader, row, condition, methods, config, pace)
            progress.advance(1, f"{condition.name}, {row.clip}")
        if config.made is not None:
            few = {archive: spread(of, config.made_clips) for archive, of in clips.items()}
            keep_motions(reader, few, conditions[0], methods, config, config.made, inputs)
    figures = {
        "clips": {archive: len(of) for archive, of in clips.items()},
        "conditions": list(dict.fromkeys(condition.name for condition in conditions)),
        "methods": [method.name for method in methods],
    }
    with write_artefact(config.output, "metrics", stage="measure-solve", config=config, inputs=inputs) as draft:
        draft.summary.update(figures, frames_per_s=pace.frames_per_s())
        write_metrics(draft.folder, rows, summary_md(config, rows))
    paces = ", ".join(f"{name} {rate:.0f}" for name, rate in pace.frames_per_s().items())
    lines = [*terminal_lines(rows), f"Frames a second here, with true clouds: {paces or 'not measured'}."]
    lines.append(f"All tables: {config.output}, summary.md.")
    return StageReport(output=config.output, lines=lines, figures={**figures, "frames_per_s": pace.frames_per_s()})


def chosen_clips(reader: MotionReader, config: Config) -> dict[str, list[ClipRow]]:
    """Clips to measure that are long enough, by archive."""
    found: dict[str, list[ClipRow]] = {}
    for row in sorted(reader.clips, key=lambda row: (archive_of(row), row.clip)):
        if row.split in config.splits and resampled_frames(row.frames, row.fps, MODEL_FPS) >= LEAST_FRAMES:
            found.setdefault(archive_of(row), []).append(row)
    if not found:
        raise InputError(
            f"{config.motion} has no clip of the split {' or '.join(config.splits)} with {LEAST_FRAMES} frames.",
            "Name other splits with --splits.",
        )
    return {archive: spread(rows, config.clips) for archive, rows in found.items()}


def spread(rows: Sequence[ClipRow], count: int) -> list[ClipRow]:
    """At most this many rows, spread evenly; 0 for all."""
    if not count or len(rows) <= count:
        return list(rows)
    return [rows[(2 * i + 1) * len(rows) // (2 * count)] for i in range(count)]


@dataclass
class _Pace:
    """Computed frames and seconds, by method, with true clouds. Not part of the artefact, since it differs between
    runs."""

    frames: Counter[str] = field(default_factory=Counter)
    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))

    def frames_per_s(self) -> dict[str, float]:
        return {name: round(self.frames[name] / spent, 1) for name, spent in self.seconds.items() if spent > 0}


def _measured(
    reader: MotionReader, row: ClipRow, condition: Condition, methods: Sequence[Method], config: Config, pace: _Pace
) -> Iterator[MetricRow]:
    motion = resample(reader.motion(row.clip), MODEL_FPS)
    if condition.name != TRUE:
        motion = shortened(motion, config.condition_seconds)
    case = condition.make(Rigged(reader.skeleton(row.skeleton), motion), rng_of(config.seed, row))
    for method, figures in _measurements(case, methods, pace if condition.name == TRUE else _Pace()):
        for metric, value in figures.items():
            yield MetricRow(
                clip=row.clip,
                skeleton=row.skeleton,
                archive=archive_of(row),
                method=method,
                task=condition.name,
                interval=condition.interval,
                metric=metric,
                value=value,
                windows=case.motion.frames,
            )


def _measurements(case: Case, methods: Sequence[Method], pace: _Pace) -> Iterator[tuple[str, dict[str, float]]]:
    true_places = positions_of(case.skeleton, case.motion)
    skate = skate_mps(case.skeleton, true_places, true_places, case.motion.fps)
    if np.isfinite(skate):
        yield TRUTH, {"skate_mps": skate}
    for method in methods:
        started = time.perf_counter()
        made = method.make(case)
        if made is not None:
            pace.seconds[method.name] += time.perf_counter() - started
            pace.frames[method.name] += case.motion.frames
            yield method.name, measurements_of(case.skeleton, case.motion, made)
