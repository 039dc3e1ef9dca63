"""The common parts of the training stages: pools of windows, the final checkpoint of a run, its model card."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.checkpoint import LAST, read_checkpoint, write_checkpoint
from data_schemas.clips import ClipReader
from data_schemas.errors import InputError
from data_schemas.manifest import Artefact
from data_schemas.tpc import TpcReader
from data_schemas.trainings import Training, TrainingData, last_sentence, training_data
from stages.shared.contract import StageReport
from stages.shared.training.config import TrainingConfig
from stages.shared.training.loop import Trained
from stages.shared.training.ranks import started_ranks
from stages.shared.training.unfinished import Unfinished
from stages.shared.training.windows import WindowPool

_CPU = torch.device("cpu")


def window_pools(
    reader: TpcReader, config: TrainingConfig, device: torch.device = _CPU
) -> tuple[WindowPool, WindowPool]:
    """Pools for training and for validation; without validation clips, the training clips are used for both.

    On a GPU windows are made there, unless worker processes draw them. The reader must stay open while the pools are
    in use.
    """
    where = device if config.workers == 0 else _CPU
    training = WindowPool(reader, ("train",), balance=config.balance, cache_mb=config.cache_mb, device=where)
    try:
        return training, WindowPool(reader, ("val",), balance=config.balance, cache_mb=0)
    except InputError:
        return training, training


def data_of(*readers: ClipReader) -> TrainingData:
    """The facts of the clips that are trained on: those of the split `train` in all artefacts."""
    return training_data([row for reader in readers for row in reader.clips if row.split == "train"])


def finish(
    config: TrainingConfig,
    trained: Trained,
    *,
    stage: str,
    network: Mapping[str, Any],
    data: TrainingData,
    inputs: Sequence[Artefact],
) -> StageReport:
    """Write the checkpoint artefact of a finished run and remove the unfinished one; report a run that is unfinished.

    The artefact holds the averaged weights of the best validation, with `keep_optimiser` the optimiser's state, and
    where the task keeps both, the last averaged weights under names that begin with `LAST`.
    Only the first of several processes writes and reports.
    """
    if not started_ranks().first:
        return StageReport()
    if not trained.finished:
        minutes = f"{trained.seconds / 60:.1f}"
        if config.last_step is None:
            place = f"step {trained.step} after {minutes} of {config.minutes:g} minutes"
        else:
            place = f"step {trained.step} of {config.last_step} after {minutes} minutes"
        return StageReport(
            lines=[f"Stopped at {place}; run the same command again to continue."],
            figures={"step": trained.step, "finished": False, "seconds": trained.seconds},
        )
    trainings = [Training(steps=trained.step, minutes=round(trained.seconds / 60, 1), data=data)]
    if config.initial is not None:
        initial = open_artefact(config.initial, "checkpoint")
        inputs, trainings = [*inputs, initial], [*read_checkpoint(initial, optimiser=False).trainings, *trainings]
    weights = {name: value.astype(np.float32) for name, value in trained.weights.items()}
    last = {LAST + name: value.astype(np.float32) for name, value in (trained.last or {}).items()}
    count = sum(value.size for value in weights.values())
    licences = sorted({licence for artefact in inputs for licence in artefact.manifest.licences})
    measured = next((row for row in trained.log if row["split"] == "val" and row["step"] == trained.best_step), {})
    card = _card(stage, config, trainings, trained.best_step, licences, count, measured)
    with write_artefact(
        config.output, "checkpoint", stage=stage, config=config.model_dump(mode="json"), inputs=inputs
    ) as draft:
        write_checkpoint(
            draft.folder,
            weights={**weights, **last},
            config={**network, "window": config.window, "points": config.points},
            optimiser=trained.optimiser,
            log=trained.log,
            card=card,
            trainings=trainings,
        )
    Unfinished(config).forget()
    figures = {"step": trained.step, "finished": True, "seconds": trained.seconds, "parameters": count}
    figures |= {"val": measured}
    return StageReport(
        output=config.output,
        lines=[
            f"{stage}: {count / 1e6:.2f} M parameters, {trained.step} steps in {trained.seconds / 60:.1f} minutes, "
            f"best validation score {trained.best:.4g}, trained on {data.sentence}."
        ],
        figures=figures,
    )


def _told(training: Training) -> str:
    return f"{training.steps} steps in {training.minutes} minutes"


def _on_other(training: Training, last: Training) -> str:
    """On what data a training was, where they are known and others than the last training's."""
    if training.data is None or (last.data is not None and training.data.agrees_with(last.data)):
        return ""
    return f", on {training.data.sentence}"


def _card(
    stage: str,
    config: TrainingConfig,
    trainings: Sequence[Training],
    best_step: int,
    licences: Sequence[str],
    count: int,
    measured: Mapping[str, Any],
) -> str:
    last = trainings[-1]
    lines = [
        f"# {stage}: weights of pumps",
        "",
        f"- Trained on: {last_sentence(trainings)}.",
        "- Licences of the data, which the weights carry, apart from the code's Apache-2.0:",
        *[f"  - {licence}" for licence in licences or ["none stated"]],
        f"- Size: {count:,} parameters.",
        *[f"- Started from: weights of {_told(each)}{_on_other(each, last)}." for each in reversed(trainings[:-1])],
        f"- Training: {_told(last)}, a step of {config.batch} windows of {config.window} frames"
        f"{f' of {config.points} points' if config.points else ''}, seed {config.seed}.",
        "",
        f"Validation of these weights, at step {best_step}:",
        "",
        "| figure | value |",
        "|---|---|",
        *[f"| {name} | {measured[name]:.5g} |" for name in measured if name not in ("step", "seconds", "split")],
        "",
    ]
    return "\n".join(lines)
