"""`pumps weights adapt`: weights and a user's recordings in, weights that are better on such recordings out."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from data_schemas.artefact import open_artefact, partial_folder
from data_schemas.checkpoint import Checkpoint, read_checkpoint
from data_schemas.clips import ClipRow
from data_schemas.disk import disk_faults_reported
from data_schemas.errors import UsageError
from data_schemas.manifest import Artefact
from data_schemas.own_folders import make_own_folder, remove_own_folder
from data_schemas.trainings import Training, training_data
from stages.shared.contract import StageReport
from stages.shared.inference.models import Models, load_synthesiser, load_weights
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.outputs import check_folder
from stages.shared.progress import SILENT, Progress
from stages.shared.training.loop import Trained
from stages.shared.training.unfinished import Unfinished
from stages.shared.weights.shipped import (
    CARD_NAME,
    CONFIDENCE_NAME,
    MEASURED_NAME,
    PARTS,
    VARIATION_NAME,
    parts_of,
    weights_folder,
)
from stages.weights.adapt.choosing import Choice, Errors, choose
from stages.weights.adapt.clips import Read, read_clips
from stages.weights.adapt.config import Config
from stages.weights.adapt.holding_out import hold_out
from stages.weights.adapt.measuring import TASKS, HeldWindow, measure, slerp_errors, windows_of
from stages.weights.adapt.training import halved, mean_of, train_on, training_config, write_clouds
from stages.weights.adapt.writing import Adapted, write_weights

START, TRAINED, MEAN = "start", "trained", "mean"
FITTED = ", confidence fitted anew"


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Train weights on with a part of the recordings, measure candidates on the rest, and write the best.

    Candidates are the weights at the start, the trained ones and the mean of both, each with the confidence at the
    start and with one that is fitted anew. Weights that are not better than those at the start are not kept.

    Raises: InputError for bad weights, if no recording is a humanoid's motion, or if they are too short to hold some
        of them out; PumpsError if the loss is not a number.
    """
    check_folder(config)
    _check_replaced(config.output)
    models = load_weights(config.weights, config.device)
    ae, lms = (open_artefact(path, "checkpoint") for path in parts_of(weights_folder(config.weights)))
    start = read_checkpoint(lms, optimiser=False)
    read = read_clips(config, progress)
    clips = read.clips
    parts = hold_out([clip.motion.frames for clip in clips], models.window, config.seed)
    windows = windows_of(clips, parts, config.max_windows)
    folder = partial_folder(config.output)
    settings = training_config(config, folder, models, start)
    try:
        with disk_faults_reported(folder):
            make_own_folder(folder)
        rows = write_clouds(settings.tpc, clips, parts, settings.points, config.seed)
        trained = train_on(settings, models, progress)
        weights = {
            START: halved(start.weights),
            TRAINED: halved(trained.weights),
            MEAN: halved(mean_of(start, trained.weights)),
        }
        found = _measured(config, models, start, lms, weights, windows, progress)
        facts = _facts(config, ae, lms, trained, found)
        adapted = _adapted(found, start, weights, trained, rows, facts)
        made = folder / "weights"
        shutil.rmtree(made, ignore_errors=True)
        write_weights(made, config.output.name, weights_folder(config.weights), ae, lms, adapted)
        _settle(made, config.output, folder)
        Unfinished(settings).forget()
    finally:
        if not any(Unfinished(settings).folder.glob("checkpoints/step_*/manifest.json")):
            remove_own_folder(folder)
    return _report(config, read, found, facts)


@dataclass(frozen=True)
class _Found:
    """What was measured: the choice, the errors of the windows, each candidate's, and the trusts fitted."""

    choice: Choice
    errors: Errors
    candidates: dict[str, np.ndarray]
    trusts: dict[str, np.ndarray]


def _measured(
    config: Config,
    models: Models,
    start: Checkpoint,
    lms: Artefact,
    weights: dict[str, dict[str, np.ndarray]],
    windows: list[HeldWindow],
    progress: Progress,
) -> _Found:
    progress.start("filling held-out windows", len(weights) * len(windows))
    candidates: dict[str, np.ndarray] = {}
    trusts: dict[str, np.ndarray] = {}
    for name, values in weights.items():
        network = load_synthesiser(replace(start, weights=values), models.autoencoder, lms.path)
        made = measure(replace(models, synthesiser=network), windows, config.seed, progress.advance)
        candidates |= {name: made.as_they_are, name + FITTED: made.fitted}
        trusts[name] = made.trust
    errors = Errors(
        np.array([window.span for window in windows]),
        np.array([window.task for window in windows]),
        slerp_errors(windows),
    )
    return _Found(choose(errors, START, candidates), errors, candidates, trusts)


def _adapted(
    found: _Found,
    start: Checkpoint,
    weights: dict[str, dict[str, np.ndarray]],
    trained: Trained,
    rows: list[ClipRow],
    facts: dict[str, Any],
) -> Adapted:
    name = found.choice.name
    kept = name.removesuffix(FITTED)
    trainings = start.trainings
    if kept != START:
        training = Training(steps=trained.step, minutes=round(trained.seconds / 60, 1), data=training_data(rows))
        trainings = (*trainings, training)
    return Adapted(
        replace(start, weights=weights[kept], trainings=trainings),
        found.trusts[kept] if name.endswith(FITTED) else None,
        changed=name != START,
        licences=sorted({row.licence for row in rows}),
        facts=facts,
        lines=_table(found),
    )


def _facts(config: Config, ae: Artefact, lms: Artefact, trained: Trained, found: _Found) -> dict[str, Any]:
    """What the adaptation was, as plain data."""
    choice = found.choice
    return {
        "weights": Path(config.weights).name,
        "digests": {"ae": ae.manifest.digest, "lms": lms.manifest.digest},
        "kept": choice.name,
        "steps": trained.step,
        "minutes": round(trained.seconds / 60, 2),
        "held_out": {
            "spans": len(np.unique(found.errors.spans)),
            "windows": len(found.errors.tasks),
            "scores": {name: round(found.errors.score(errors), 4) for name, errors in found.candidates.items()},
            "gain": round(choice.gain, 4),
            "standard_error": round(choice.standard_error, 4),
            "better": round(choice.better, 3),
        },
    }


def _table(found: _Found) -> list[str]:
    """Before and after, as Markdown: L2P as a share of slerp's."""
    before = found.errors.ratios(found.candidates[START])
    after = found.errors.ratios(found.candidates[found.choice.name])
    names = [f"{TASKS[task].name} {TASKS[task].interval}" for task in before]
    return [
        f"| | {' | '.join(names)} |",
        f"|---|{'---:|' * len(names)}",
        f"| before | {' | '.join(f'{value:.3f}' for value in before.values())} |",
        f"| after | {' | '.join(f'{value:.3f}' for value in after.values())} |",
    ]


def _check_replaced(output: Path) -> None:
    """Raise UsageError for a folder that holds other things than weights, since it is replaced as a whole."""
    names = {name for parts in PARTS for name in parts}
    names |= {CARD_NAME, CONFIDENCE_NAME, MEASURED_NAME, VARIATION_NAME}
    if output.is_dir() and (other := sorted({entry.name for entry in output.iterdir()} - names)):
        raise UsageError(f"{output} holds {other[0]}, which is no part of weights.", "Give another folder.")


def _settle(made: Path, output: Path, folder: Path) -> None:
    """Move the finished weights to their place; weights that they replace are moved aside first."""
    output = output.resolve()
    aside = folder / "replaced"
    with disk_faults_reported(output):
        if output.is_dir():
            shutil.rmtree(aside, ignore_errors=True)
            os.replace(output, aside)
        try:
            os.replace(made, output)
        except OSError:
            if aside.is_dir():
                os.replace(aside, output)
            raise


def _report(config: Config, read: Read, found: _Found, facts: dict[str, Any]) -> StageReport:
    choice, errors = found.choice, found.errors
    before, after = (errors.score(found.candidates[name]) for name in (START, choice.name))
    seconds = sum(clip.motion.frames for clip in read.clips) / MODEL_FPS
    windows = f"{facts['held_out']['windows']} windows of held-out recordings"
    if choice.name == START:
        outcome = (
            f"No candidate was better than {config.weights} on {windows} by more than its standard error and in most "
            f"of them, so {config.output} holds the weights of {config.weights} as they were."
        )
    else:
        outcome = (
            f"On {windows} the error is {after:.3f} of slerp's, and with {config.weights} {before:.3f}: a gain of "
            f"{choice.gain:.3f} with a standard error of {choice.standard_error:.3f}. Kept: {choice.name}."
        )
    lines = [
        f"{len(read.clips)} recordings, {seconds / 60:.1f} minutes; {facts['steps']} steps in "
        f"{facts['minutes']:.1f} minutes.",
        outcome,
        *_table(found),
        *[f"left out: {sentence}" for sentence in read.left_out],
    ]
    return StageReport(output=config.output, lines=lines, figures={**facts, "before": before, "after": after})
