"""`pumps measure estimate`: networks that see the same keypoints of the same windows, measured by category."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.clips import ClipRow
from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import open_artefact
from data_schemas.metrics import MetricRow, write_metrics
from data_schemas.tpc import TpcReader
from stages.measure.estimate.config import Config
from stages.measure.estimate.summary import METRICS, REST, summary_md, terminal_lines
from stages.shared.contract import StageReport
from stages.shared.inference.held_out_tasks import made_of_batch, task_batch
from stages.shared.inference.pose_model import PoseModel, load_pose_model
from stages.shared.outputs import check_artefact
from stages.shared.pose_tasks.body_pose import BodyPose
from stages.shared.pose_tasks.estimate import EstimateTask
from stages.shared.pose_tasks.task import TaskBatch
from stages.shared.progress import SILENT, Progress
from stages.shared.statistics.metrics import mpjpe_mm, mpjve_mm
from stages.shared.statistics.rig_windows import windows_by_category
from stages.shared.statistics.tasks import ESTIMATION
from stages.shared.training.pose_training import sets_of_rig
from stages.shared.weights.shipped import named_source
from stages.shared.weights.task_weights import task_weights


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Measure every network on the same windows and cameras; write `metrics`.

    Raises: UsageError for two networks of one name; InputError for networks of different rigs or corruptions, or
        where no held-out clip of the rig is long enough.
    """
    check_artefact(config, "metrics")
    models = _models(config)
    task = _one_task(models)
    with TpcReader(config.tpc) as reader:
        windows = [*_windows(reader, task, config)]
        inputs = [reader.artefact, *(open_artefact(_folder(text), "checkpoint") for text in config.weights)]
        progress.start("estimating", len(windows) * (len(models) + 1))
        rows = []
        for category, clip, starts in windows:
            batches = [task_batch(reader, task, clip, start, config.window, config.seed) for start in starts]
            for name, model in [(REST, None), *models.items()]:
                figures = np.array([_figures(task, made_of_batch(model, batch), batch) for batch in batches])
                place = (clip.clip, clip.skeleton, category, name, ESTIMATION, config.window)
                for metric, value in zip(METRICS, figures.mean(axis=0), strict=True):
                    rows.append(MetricRow(*place, metric, float(value), windows=len(starts)))
                progress.advance(1, f"{category}, {name}")
    with write_artefact(config.output, "metrics", stage="measure-estimate", config=config, inputs=inputs) as draft:
        count = sum(len(starts) for *_, starts in windows)
        draft.summary.update(windows=count, methods=[REST, *models])
        write_metrics(draft.folder, rows, summary_md(config, rows, models))
    return StageReport(
        output=config.output,
        lines=[*terminal_lines(rows, config.seed), f"Full tables: {config.output}, summary.md."],
        figures={"windows": count, "methods": [REST, *models]},
    )


def _folder(text: str) -> Path:
    return task_weights(named_source(text)[1])


def _models(config: Config) -> dict[str, PoseModel]:
    models: dict[str, PoseModel] = {}
    for text in config.weights:
        name, source = named_source(text)
        if name in models or name == REST:
            raise UsageError(f"Two rows are called {name!r}.", f"Give another name: --weights NAME={source}.")
        models[name] = load_pose_model(task_weights(source), "estimate", config.device)
    return models


def _one_task(models: dict[str, PoseModel]) -> EstimateTask:
    """The task of all networks. Raises InputError if they see different keypoints or move different rigs."""
    (first, model), *others = models.items()
    for name, other in others:
        if other.task.corruption != model.task.corruption or not other.rig.is_like(model.rig):
            raise InputError(
                f"{first} and {name} see different keypoints, or move different rigs.", "Measure them one by one."
            )
    assert isinstance(model.task, EstimateTask)
    return model.task


def _windows(reader: TpcReader, task: EstimateTask, config: Config) -> Iterator[tuple[str, ClipRow, list[int]]]:
    own, most = sets_of_rig(reader, task.rig), config.max_windows
    return windows_by_category(reader.clips, own, config.splits, config.category, config.window, most, config.tpc)


def _figures(task: EstimateTask, made: BodyPose, batch: TaskBatch) -> list[float]:
    """MPJPE and MPJVE of positions from the root, and MPJPE of the root alone, as in `METRICS`."""
    body = task.rig.body
    found, truth = (pose.heads(body)[0].double().numpy() for pose in (made, batch.target))
    rooted = [heads - heads[:, :1] for heads in (found, truth)]
    return [float(mpjpe_mm(*rooted)), float(mpjve_mm(*rooted)), float(mpjpe_mm(found[:, :1], truth[:, :1]))]
