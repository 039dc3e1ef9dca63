"""What fills the gaps of `pumps infill`: the models of weights, or transition concepts."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_schemas.errors import UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.infill.config import Config
from stages.shared.inference.cloud_sources import SynthesisedClouds
from stages.shared.inference.constraints.fixed import Fixed
from stages.shared.inference.filled import Filled
from stages.shared.inference.filling import FillOptions, fill_motion
from stages.shared.inference.kept_models import kept_models
from stages.shared.inference.models import Models
from stages.shared.inference.variation import variation_of
from stages.shared.inference.varied_fills import varied_fill
from stages.shared.kinematics.conventions import MODEL_FPS


@dataclass(frozen=True)
class Filler:
    """Fills gaps, and says what it learned from.

    name:        of the weights.
    window:      model frames (30 a second) beyond which keys change nothing.
    longest_gap: model frames, the longest gap that it was trained on.
    trained_on, licences: of the training data. shown_by: the command that shows them.
    fills:       called with a skeleton, T frames of a motion, which of them are known (T,), and what is given beside
                 whole keys; returns the fills that `config.wanted` names.
    """

    name: str
    window: int
    longest_gap: int
    trained_on: str
    licences: tuple[str, ...]
    shown_by: str
    fills: Callable[[Skeleton, Motion, np.ndarray, Fixed | None], list[Filled]]


def filler_of(config: Config) -> Filler:
    """What `config.method` names, with its weights loaded. Raises InputError for weights that are not there."""
    return _models(config) if config.method == "pumps" else _concepts(config)


def _models(config: Config) -> Filler:
    """An autoencoder and a synthesiser."""
    models = kept_models(config.weights, config.device)

    def fills(skeleton: Skeleton, given: Motion, known: np.ndarray, fixed: Fixed | None) -> list[Filled]:
        return _by_models(models, config, skeleton, given, known, fixed)

    shown_by = shlex.join(["pumps", "weights", "show", models.name])
    return Filler(models.name, models.window, models.longest_gap, models.trained_on, models.licences, shown_by, fills)


def _by_models(
    models: Models, config: Config, skeleton: Skeleton, given: Motion, known: np.ndarray, fixed: Fixed | None
) -> list[Filled]:
    """Raises InputError where another fill than the usual is wanted and the weights do not hold how motions vary."""
    options = FillOptions(foot_lock=config.foot_lock)
    variation = variation_of(models) if config.wanted != (1,) else None  # before filling: weights may lack it
    usual = fill_motion(
        skeleton, given, known, SynthesisedClouds(models),
        points=config.points, seed=config.seed, device=models.autoencoder.device, options=options, fixed=fixed,
    )  # fmt: skip
    if variation is None:
        return [usual]
    return [
        usual
        if number == 1
        else varied_fill(
            skeleton, usual, known, models.autoencoder, variation, seeds=(config.seed, number),
            points=config.points, options=options, fixed=fixed,
        )
        for number in config.wanted
    ]  # fmt: skip


def _concepts(config: Config) -> Filler:
    """Transition concepts of one rig (motion concepts 3.1.3), which fill between whole keyframes."""
    # Only fills by concepts load these.
    from stages.shared.inference.concept_filling import concept_fill
    from stages.shared.inference.refining import kept_concepts

    if not Path(config.weights).is_dir():
        raise UsageError(
            f"--method concepts needs the checkpoint of a rig, and {config.weights!r} is no folder.",
            "Give --weights the folder that `pumps train concepts` wrote.",
        )
    model = kept_concepts(Path(config.weights), config.device)

    def fills(skeleton: Skeleton, given: Motion, known: np.ndarray, fixed: Fixed | None) -> list[Filled]:
        if fixed is not None:
            raise UsageError(
                "--method concepts fills between whole keyframes.", "Leave the other constraints out, or the method."
            )
        options = FillOptions(foot_lock=config.foot_lock)
        codes = [None if number == 1 else (config.seed, number) for number in config.wanted]
        return [concept_fill(model, skeleton, given, known, seeds=each, options=options) for each in codes]

    frames = round(model.window * MODEL_FPS / model.fps)
    shown_by = shlex.join(["pumps", "artefact", "show", config.weights])
    return Filler(config.weights, frames, frames, model.trained_on, model.licences, shown_by, fills)
