"""What fills the gaps of `pumps infill`: the models of weights, or transition concepts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

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


class Filler(Protocol):
    """Fills gaps, and says what it learned from.

    name: of the weights. window: frames at 30 a second beyond which keys change nothing. longest_gap: frames at 30 a
    second, the longest that it was trained on. trained_on, licences: of the training data.
    """

    @property
    def name(self) -> str: ...
    @property
    def window(self) -> int: ...
    @property
    def longest_gap(self) -> int: ...
    @property
    def trained_on(self) -> str: ...
    @property
    def licences(self) -> tuple[str, ...]: ...

    def fills(
        self, skeleton: Skeleton, given: Motion, known: np.ndarray, fixed: Fixed | None, config: Config
    ) -> list[Filled]:
        """`config.samples` fills, the usual one first.

        Args:
            given: T frames of which only those of `known` (T,) are read. fixed: what is given beside whole keys.
        """
        ...


def filler_of(config: Config) -> Filler:
    """What `config.method` names, with its weights loaded. Raises InputError for weights that are not there."""
    if config.method == "pumps":
        return ModelFiller(kept_models(config.weights, config.device))
    if not Path(config.weights).is_dir():
        raise UsageError(
            f"--method concepts needs the checkpoint of a rig, and {config.weights!r} is no folder.",
            "Give --weights the folder that `pumps train concepts` wrote.",
        )
    return ConceptFiller(Path(config.weights), config.device)


@dataclass(frozen=True)
class ModelFiller:
    """An autoencoder and a synthesiser."""

    models: Models

    @property
    def name(self) -> str:
        return self.models.name

    @property
    def window(self) -> int:
        return self.models.window

    @property
    def longest_gap(self) -> int:
        return self.models.longest_gap

    @property
    def trained_on(self) -> str:
        return self.models.trained_on

    @property
    def licences(self) -> tuple[str, ...]:
        return self.models.licences

    def fills(
        self, skeleton: Skeleton, given: Motion, known: np.ndarray, fixed: Fixed | None, config: Config
    ) -> list[Filled]:
        """As `Filler.fills`; raises InputError where several are wanted and the weights do not hold how motions
        vary."""
        models, options = self.models, FillOptions(foot_lock=config.foot_lock)
        variation = variation_of(models) if config.samples > 1 else None  # before filling: weights may lack it
        usual = fill_motion(
            skeleton, given, known, SynthesisedClouds(models),
            points=config.points, seed=config.seed, device=models.autoencoder.device, options=options, fixed=fixed,
        )  # fmt: skip
        if variation is None:
            return [usual]
        return [usual] + [
            varied_fill(
                skeleton, usual, known, models.autoencoder, variation, seeds=(config.seed, number),
                points=config.points, options=options, fixed=fixed,
            )
            for number in range(2, config.samples + 1)
        ]  # fmt: skip


class ConceptFiller:
    """Transition concepts of one rig (motion concepts 3.1.3)."""

    def __init__(self, path: Path, device: str):
        # Only fills by concepts load these.
        from stages.shared.inference.concept_filling import concept_fill
        from stages.shared.inference.refining import kept_concepts

        self._model, self._fill = kept_concepts(path, device), concept_fill
        self.name = str(path)
        self.window = self.longest_gap = round(self._model.window * MODEL_FPS / self._model.fps)
        self.trained_on, self.licences = self._model.trained_on, self._model.licences

    def fills(
        self, skeleton: Skeleton, given: Motion, known: np.ndarray, fixed: Fixed | None, config: Config
    ) -> list[Filled]:
        """As `Filler.fills`; raises UsageError for anything but whole keyframes."""
        if fixed is not None:
            raise UsageError(
                "--method concepts fills between whole keyframes.", "Leave the other constraints out, or the method."
            )
        options = FillOptions(foot_lock=config.foot_lock)
        codes = [None, *((config.seed, number) for number in range(2, config.samples + 1))]
        return [self._fill(self._model, skeleton, given, known, seeds=each, options=options) for each in codes]
