"""`pumps evaluate`: fill windows of clips whose truth is known, and measure (docs/evaluation.md)."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from itertools import groupby
from typing import NamedTuple

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.errors import InputError
from data_schemas.fills import FillsWriter
from data_schemas.manifest import open_artefact
from data_schemas.metrics import MetricRow, write_metrics
from data_schemas.motion import MotionReader
from data_schemas.version import code_digest
from stages.evaluate.concept_methods import Refiner, refiner_of
from stages.evaluate.config import Config
from stages.evaluate.kept_fills import check_size, kept_batch
from stages.evaluate.measured_clips import MeasuredClips, WindowBatch
from stages.evaluate.methods import Loaded, Made, load_all, methods_for
from stages.evaluate.summary import summary_md
from stages.shared.contract import StageReport
from stages.shared.inference.models import window_seams
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.statistics.categories import named
from stages.shared.statistics.feel import TrueFeet, feel, true_feet
from stages.shared.statistics.feel_tables import feel_lines
from stages.shared.statistics.measurements import (
    POWER_WEIGHTED,
    TRUTH,
    Measurements,
    Truth,
    first_frame_of,
    hip_joints,
    is_lafan1,
    measure,
    measure_lafan1,
    measured_joints,
    metric_named,
    position_deviation,
)
from stages.shared.statistics.method_notes import MeasuredWeights, MethodFacts
from stages.shared.statistics.pop_tables import pop_lines
from stages.shared.statistics.tables import cells, terminal_lines
from stages.shared.statistics.tasks import INTERPOLATION, PREDICTION, TRANSITION
from stages.shared.statistics.windows import CONTEXT, LAFAN1_CONTEXT, LAFAN1_STRIDE, Task, Window


@dataclass
class _Tally:
    """Values, weights and first frames of a clip's windows, per method and metric."""

    values: dict[tuple[str, str, str], list[tuple[float, float, int]]] = field(
        default_factory=lambda: defaultdict(list)
    )

    def add(self, windows: Iterable[Window], method: str, figures: Measurements) -> None:
        for metric, (values, weights) in figures.items():
            for window, value, weight in zip(windows, values, weights, strict=True):
                if np.isfinite(value):
                    self.values[window.clip, method, metric].append((float(value), float(weight), window.start))


@dataclass
class Spent:
    """Seconds and frames of each method's filling."""

    of: dict[str, tuple[float, int]] = field(default_factory=dict)

    def add(self, method: str, seconds: float, frames: int) -> None:
        before = self.of.get(method, (0.0, 0))
        self.of[method] = (before[0] + seconds, before[1] + frames)

    def milliseconds(self) -> dict[str, float]:
        """Milliseconds of filling a frame, known frames counted too."""
        return {method: round(1000 * seconds / frames, 4) for method, (seconds, frames) in self.of.items()}


@dataclass
class _Statistics:
    """The lafan1 protocol's deviations, computed once for each skeleton."""

    clips: MeasuredClips
    made: dict[str, np.ndarray] = field(default_factory=dict)
    borrowed: list[str] = field(default_factory=list)

    def of(self, batch: WindowBatch, joints: np.ndarray, across: np.ndarray) -> np.ndarray:
        if batch.skeleton_id not in self.made:
            windows, of_training = self.clips.statistics_windows(batch.skeleton_id)
            self.made[batch.skeleton_id] = position_deviation(
                windows.positions,
                joints,
                across,
                batch.skeleton.root,
                windows.roots if is_lafan1(batch.skeleton) else None,
            )
            if not of_training:
                self.borrowed.append(batch.skeleton_id)
        return self.made[batch.skeleton_id]


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Measure every method on every task and write a `metrics` artefact.

    Raises:
        InputError: the motion artefact is bad, or has no clip of the wanted splits that is long enough.
        UsageError: two methods share a name.
    """
    check_artefact(config, "metrics")
    motion = open_artefact(config.motion, "motion")
    loaded = load_all(config)
    inputs = [motion, *(path for weights in loaded for path in weights.artefacts())]
    if config.refine is not None:
        inputs.append(config.refine)
    with (
        MotionReader(motion) as reader,
        write_artefact(config.output, "metrics", stage="evaluate", config=config, inputs=inputs) as draft,
    ):
        trained_on = [data for weights in loaded for data in weights.trained_on()] if config.unseen else None
        clips = MeasuredClips(reader, config.splits, config.where, trained_on, named("category", config.category))
        plan = _plan(clips, config)
        refiner = refiner_of(config, reader, (window for _, _, windows in plan for window in windows))
        total = sum(len(windows) * len(methods_for(task, loaded, config, refiner)) for _, task, windows in plan)
        if config.keep_fills:
            # Beside the methods' fills, the true motion is kept.
            motions = {task: 1 + len(methods_for(task, loaded, config, refiner)) for _, task, _ in plan}
            check_size(((window, motions[task]) for _, task, windows in plan for window in windows), reader)
        progress.start("Filling windows", total)
        rows: list[MetricRow] = []
        with FillsWriter(draft.folder, MODEL_FPS) if config.keep_fills else nullcontext() as fills:
            measuring = _Measuring(config, clips, loaded, refiner, progress, _Statistics(clips), fills)
            for archive, group in groupby(plan, key=lambda step: step[0]):
                for _, task, windows in group:
                    rows += _rows(reader, archive, task, _measure_task(measuring, archive, task, windows))
                clips.forget()
        found = cells(rows, config.seed)
        facts = MethodFacts(
            weights=[_facts(each, clips) for each in loaded],
            breakdown=config.breakdown,
            refined=config.refine is not None,
            borrowed_statistics=measuring.statistics.borrowed,
        )
        draft.summary |= _counts(rows, plan) | facts.model_dump() | {"code": code_digest()}
        draft.summary["milliseconds_per_frame"] = measuring.spent.milliseconds()
        write_metrics(draft.folder, rows, summary_md(config, motion, rows, found, facts))
    where = f"Full tables: {config.output}, summary.md (pumps report draws them)."
    lines = [*terminal_lines(found), *feel_lines(found), *pop_lines(rows), where]
    return StageReport(output=config.output, lines=lines, figures=_counts(rows, plan))


def tasks_of(config: Config) -> list[Task]:
    """The tasks that a config asks for, in its order."""
    lafan1 = config.protocol == "lafan1"
    context = LAFAN1_CONTEXT if lafan1 else (CONTEXT, CONTEXT)
    lengths = {INTERPOLATION: config.intervals, TRANSITION: config.transitions, PREDICTION: config.predictions}
    return [
        Task(name, interval, config.window, context, LAFAN1_STRIDE if lafan1 and name == TRANSITION else 0)
        for name in dict.fromkeys(config.tasks)
        for interval in dict.fromkeys(lengths[name])
    ]


def _plan(clips: MeasuredClips, config: Config) -> list[tuple[str, Task, list[Window]]]:
    plan = []
    for archive in clips.archives:
        for task in tasks_of(config):
            windows = clips.windows(archive, task, config.max_windows)
            if windows:
                plan.append((archive, task, windows))
    if not plan:
        raise InputError(
            f"No clip of {config.motion} in the split {' or '.join(config.splits)} is long enough to be measured.",
            "Clips need 46 frames at 30 fps, and a transition its whole window; ask for shorter --transitions.",
        )
    return plan


@dataclass
class _Measuring:
    """What all tasks of an evaluation share."""

    config: Config
    clips: MeasuredClips
    loaded: Sequence[Loaded]
    refiner: Refiner | None
    progress: Progress
    statistics: _Statistics
    fills: FillsWriter | None
    spent: Spent = field(default_factory=Spent)


def _measure_task(of: _Measuring, archive: str, task: Task, windows: list[Window]) -> _Tally:
    config, tally = of.config, _Tally()
    methods = methods_for(task, of.loaded, config, of.refiner)
    for batch in of.clips.batches(task, windows):
        poses = batch.poses()
        joints = measured_joints(batch.skeleton)
        truth = Truth(poses.positions.numpy(), poses.rotations.numpy(), batch.known, batch.skeleton.root)
        feet = true_feet(batch.skeleton, truth.positions) if config.protocol == "pumps" else None
        seams = window_seams(len(batch.known), [size for weights in of.loaded for size in weights.windows])
        if config.protocol == "pumps":
            tally.add(batch.windows, TRUTH, feel(truth.positions, truth.rotations, truth, joints, feet, seams=seams))
        if of.fills is not None:
            of.fills.begin(kept_batch(archive, task, batch), batch.skeleton, truth.centre()[:, 0, 0])
            of.fills.add(TRUTH, truth.positions, truth.rotations)
        measured = _MeasuredBatch(truth, batch, joints, feet, seams)
        for method in methods:
            label = f"{method.name}, {task.name} {task.interval}"
            began = time.perf_counter()
            filled = method.fill(batch, poses, lambda label=label: of.progress.advance(1, label))
            of.spent.add(method.name, time.perf_counter() - began, len(batch.windows) * len(batch.known))
            tally.add(batch.windows, method.name, _measurements(filled, measured, of.statistics, config))
            if of.fills is not None:
                of.fills.add(method.name, filled.positions, filled.rotations)
    return tally


class _MeasuredBatch(NamedTuple):
    """The measurement of a batch's windows."""

    truth: Truth
    batch: WindowBatch
    joints: np.ndarray
    feet: TrueFeet | None
    seams: np.ndarray


def _measurements(made: Made, by: _MeasuredBatch, statistics: _Statistics, config: Config) -> Measurements:
    positions, rotations, fell_back = made
    if config.protocol == "pumps":
        felt = feel(positions, rotations, by.truth, by.joints, by.feet, fell_back, by.seams)
        return measure(positions, rotations, by.truth, by.joints) | felt
    across = hip_joints(by.batch.skeleton)
    deviation = statistics.of(by.batch, by.joints, across)
    roots = is_lafan1(by.batch.skeleton)
    return measure_lafan1(positions, rotations, by.truth, by.joints, across, deviation, by_root=roots)


def _facts(loaded: Loaded, clips: MeasuredClips) -> MeasuredWeights:
    """The facts of weights, and whether they were trained on clips of the measured archives."""
    facts = loaded.facts()
    try:
        trained_on = loaded.trained_on()
    except InputError:
        return facts
    rows = [row for members in clips.archives.values() for row in members]
    native = any(data.has_seen(row) for data in trained_on for row in rows)
    return facts.model_copy(update={"native": native})


def _rows(reader: MotionReader, archive: str, task: Task, tally: _Tally) -> list[MetricRow]:
    rows = []
    for (clip, method, metric), found in tally.values.items():
        values, weights, starts = np.array(found).T
        total = weights.sum()
        if metric_named(metric).largest:
            worst = int(values.argmax())
            figures = {metric: float(values[worst]), first_frame_of(metric): float(starts[worst])}
        else:
            figures = {metric: float((values * weights).sum() / total) if total > 0 else float(values.mean())}
        for name, value in figures.items():
            rows.append(
                MetricRow(
                    clip=clip,
                    skeleton=reader.row(clip).skeleton,
                    archive=archive,
                    method=method,
                    task=task.name,
                    interval=task.interval,
                    metric=name,
                    value=value,
                    weight=float(total) if metric in POWER_WEIGHTED else 1.0,
                    windows=len(values),
                )
            )
    return rows


def _counts(rows: list[MetricRow], plan: list[tuple[str, Task, list[Window]]]) -> dict[str, object]:
    windows = {f"{archive}, {task.name} {task.interval}": len(chosen) for archive, task, chosen in plan}
    return {
        "clips": len({row.clip for row in rows}),
        "skeletons": len({row.skeleton for row in rows}),
        "methods": list(dict.fromkeys(row.method for row in rows if row.method != TRUTH)),
        "windows": windows,
    }
