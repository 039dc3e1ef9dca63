"""`pumps measure task`: networks for one task that see the same input of the same windows, measured by category."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import open_artefact
from data_schemas.metrics import MetricRow, write_metrics
from data_schemas.tpc import TpcReader
from stages.measure.task.config import Config
from stages.measure.task.summary import BASE, Measured, curve_of, summary_md, terminal_lines
from stages.shared.contract import StageReport
from stages.shared.inference.held_out_tasks import made_of_batch, task_batch
from stages.shared.inference.pose_model import PoseModel, load_pose_model
from stages.shared.outputs import check_artefact
from stages.shared.pose_tasks.task import PoseTask, TaskBatch
from stages.shared.progress import SILENT, Progress
from stages.shared.statistics.rig_windows import windows_by_category
from stages.shared.statistics.tasks import POSE_TASK
from stages.shared.training.pose_training import sets_of_rig
from stages.shared.weights.shipped import named_source
from stages.shared.weights.task_weights import task_weights

CURVE_PICTURE = "curve.svg"


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Measure every network on the same windows and the same errors of its input; write `metrics`.

    Raises: UsageError for two rows of one name; InputError for networks of different tasks, rigs or corruptions, or
        where no held-out clip of the rig is long enough.
    """
    check_artefact(config, "metrics")
    models, names = _models(config)
    task = _one_task(models)
    with TpcReader(config.tpc) as reader:
        measured = (config.category, config.window, config.max_windows, config.tpc)
        windows = [*windows_by_category(reader.clips, sets_of_rig(reader, task.rig), config.splits, *measured)]
        inputs = [reader.artefact, *(open_artefact(_folder(text), "checkpoint") for text in config.weights)]
        progress.start("measuring", sum(len(starts) for *_, starts in windows))
        rows: list[MetricRow] = []
        for category, clip, starts in windows:
            found: dict[str, list[dict[str, float]]] = {name: [] for name in (BASE, *models)}
            for start in starts:
                batch = task_batch(reader, task, clip, start, config.window, config.seed)
                for name, figures in _figures(task, models, batch).items():
                    found[name].append(figures)
                progress.advance(1, category)
            for name, each in found.items():
                place = (clip.clip, clip.skeleton, category, name, POSE_TASK, config.window)
                rows += [MetricRow(*place, m, _mean(each, m), windows=len(starts)) for m in each[0]]
    page = Measured(rows, task.name, task.corruption, models, names)
    with write_artefact(config.output, "metrics", stage="measure-task", config=config, inputs=inputs) as draft:
        count = sum(len(starts) for *_, starts in windows)
        draft.summary.update(windows=count, task=task.name, methods=[BASE, *models])
        draft.summary.update(minutes={name: model.minutes for name, model in models.items()})
        write_metrics(draft.folder, rows, summary_md(config, page))
        picture = curve_of(page)
        if picture:
            (draft.folder / CURVE_PICTURE).write_text(picture, encoding="utf-8")
    return StageReport(
        output=config.output,
        lines=[*terminal_lines(page, config.seed), f"Full tables: {config.output}, summary.md."],
        figures={"windows": count, "methods": [BASE, *models]},
    )


def _mean(figures: Sequence[Mapping[str, float]], metric: str) -> float:
    return float(np.mean([each[metric] for each in figures]))


def _figures(task: PoseTask, models: Mapping[str, PoseModel], batch: TaskBatch) -> dict[str, dict[str, float]]:
    """The task's measures of each network's pose of a window, and of the base's."""
    every: list[tuple[str, PoseModel | None]] = [(BASE, None), *models.items()]
    return {name: task.measures(made_of_batch(model, batch), batch) for name, model in every}


def _folder(text: str) -> Path:
    return task_weights(named_source(text)[1])


def _models(config: Config) -> tuple[dict[str, PoseModel], dict[str, str]]:
    """The networks by their rows, and the NAME that --weights gives each row; where a NAME has several networks, its
    rows also say their minutes of training."""
    named = [named_source(text) for text in config.weights]
    models: dict[str, PoseModel] = {}
    names: dict[str, str] = {}
    for name, source in named:
        model = load_pose_model(task_weights(source), None, config.device)
        several = sum(other == name for other, _ in named) > 1
        row = f"{name}, {model.minutes:g} min" if several else name
        if row in models or row == BASE:
            raise UsageError(f"Two rows are called {row!r}.", f"Give another name: --weights NAME={source}.")
        models[row], names[row] = model, name
    return models, names


def _one_task(models: Mapping[str, PoseModel]) -> PoseTask:
    """The task of all networks. Raises InputError if they see other inputs or move different rigs."""
    (first, model), *others = models.items()
    for name, other in others:
        same = type(other.task) is type(model.task) and other.task.corruption == model.task.corruption
        if not same or not other.rig.is_like(model.rig):
            raise InputError(
                f"{first} and {name} do different tasks, see different inputs or move different rigs.",
                "Measure them one by one.",
            )
    return model.task
