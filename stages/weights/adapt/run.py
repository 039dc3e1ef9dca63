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
from stages.weights.adapt.choosing import Candidate, Choice, Errors, choose
from stages.weights.adapt.clips import Read, read_clips
from stages.weights.adapt.config import Config
from stages.weights.adapt.holding_out import hold_out
from stages.weights.adapt.measuring import TASKS, HeldWindow, measure, slerp_errors, windows_of
from stages.weights.adapt.training import halved, mean_of, train_on, training_config, write_clouds
from stages.weights.adapt.writing import Adapted, write_weights

START, TRAINED, MEAN = "start", "trained", "mean"


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Continue the training of weights on a part of the recordings, measure candidates on the rest, write the best.

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
        if not Unfinished(settings).begun:
            remove_own_folder(folder)
    return _report(config, read, found, facts)


@dataclass(frozen=True)
class _Found:
    """What was measured: the choice, the errors of the windows, each candidate's, and the trusts fitted."""

    choice: Choice
    errors: Errors
    candidates: dict[Candidate, np.ndarray]
    trusts: dict[str, np.ndarray]

    @property
    def before(self) -> np.ndarray:
        """L2P of each window with the weights at the start, metres."""
        return self.candidates[Candidate(START)]

    @property
    def after(self) -> np.ndarray:
        """L2P of each window with the candidate that is kept, metres."""
        return self.candidates[self.choice.kept]


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
    candidates: dict[Candidate, np.ndarray] = {}
    trusts: dict[str, np.ndarray] = {}
    for name, values in weights.items():
        network = load_synthesiser(replace(start, weights=values), models.autoencoder, lms.path)
        made = measure(replace(models, synthesiser=network), windows, config.seed, progress.advance)
        candidates |= {Candidate(name): made.as_they_are, Candidate(name, fitted=True): made.fitted}
        trusts[name] = made.trust
    errors = Errors(
        np.array([window.span for window in windows]),
        np.array([window.task for window in windows]),
        slerp_errors(windows),
    )
    return _Found(choose(errors, Candidate(START), candidates), errors, candidates, trusts)


def _adapted(
    found: _Found,
    start: Checkpoint,
    weights: dict[str, dict[str, np.ndarray]],
    trained: Trained,
    rows: list[ClipRow],
    facts: dict[str, Any],
) -> Adapted:
    kept, fitted = found.choice.kept
    trainings = start.trainings
    if kept != START:
        training = Training(steps=trained.step, minutes=round(trained.seconds / 60, 1), data=training_data(rows))
        trainings = (*trainings, training)
    log = {START: start.log, TRAINED: trained.log, MEAN: []}[kept]
    return Adapted(
        replace(start, weights=weights[kept], trainings=trainings, log=log),
        found.trusts[kept] if fitted else None,
        changed=found.choice.kept != Candidate(START),
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
        "kept": choice.kept.weights,
        "confidence_fitted": choice.kept.fitted,
        "steps": trained.step,
        "minutes": round(trained.seconds / 60, 2),
        "held_out": {
            "spans": len(np.unique(found.errors.spans)),
            "windows": len(found.errors.tasks),
            "scores": [
                {
                    "weights": each.weights,
                    "confidence_fitted": each.fitted,
                    "score": round(found.errors.score(errors), 4),
                }
                for each, errors in found.candidates.items()
            ],
            "gain": round(choice.gain, 4),
            "standard_error": round(choice.standard_error, 4),
            "better": round(choice.better, 3),
        },
    }


def _table(found: _Found) -> list[str]:
    """Before and after, as Markdown: L2P as a share of slerp's."""
    before, after = found.errors.ratios(found.before), found.errors.ratios(found.after)
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
    before, after = errors.score(found.before), errors.score(found.after)
    seconds = sum(clip.motion.frames for clip in read.clips) / MODEL_FPS
    windows = f"{facts['held_out']['windows']} windows of held-out recordings"
    stretches = f"{facts['held_out']['spans']} stretches"
    if choice.kept == Candidate(START):
        outcome = (
            f"On {windows} no candidate was better than {config.weights} by more than chance in its mean gain over "
            f"the {stretches}, in more than half of them, and in the mean error over the tasks. "
            f"So {config.output} holds the weights of {config.weights} as they were."
        )
    else:
        fitted = " with the confidence fitted anew" if choice.kept.fitted else ""
        outcome = (
            f"On {windows} the mean error over the tasks is {after:.3f} of slerp's, and with {config.weights} "
            f"{before:.3f}. The mean gain over the {stretches} is {choice.gain:.3f}, its standard error (widened by "
            f"Student's t) {choice.standard_error:.3f}. Kept: {choice.kept.weights}{fitted}."
        )
    lines = [
        f"{len(read.clips)} recordings, {seconds / 60:.1f} minutes; {facts['steps']} steps in "
        f"{facts['minutes']:.1f} minutes.",
        outcome,
        *_table(found),
        *[f"left out: {sentence}" for sentence in read.left_out],
    ]
    return StageReport(output=config.output, lines=lines, figures={**facts, "before": before, "after": after})
