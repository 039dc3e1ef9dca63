"""The methods that fill the windows: the plain baselines, and models through `fill_motion`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import MANIFEST_NAME, open_artefact, sha256_of_file
from data_schemas.skeleton import Motion
from data_schemas.trainings import TrainingData, last_data
from stages.evaluate.concept_methods import LoadedConcepts, Refiner
from stages.evaluate.config import Config
from stages.evaluate.measured_clips import WindowBatch
from stages.evaluate.one_checkpoint import network_of
from stages.evaluate.pose_methods import LoadedInterpolator, loaded_interpolator
from stages.shared.inference.cloud_interfaces import CloudSource
from stages.shared.inference.cloud_sources import ReconstructedClouds, SynthesisedClouds, TrueClouds
from stages.shared.inference.filling import FillOptions, fill_motion
from stages.shared.inference.models import Models, load_weights
from stages.shared.inference.pose_filling import is_interpolator
from stages.shared.inference.refining import is_concepts, load_concepts
from stages.shared.networks.layers.device import choose_device
from stages.shared.statistics.baselines import BASELINES, PREDICTION_BASELINES, Filled, Poses, zero_velocity
from stages.shared.statistics.measurements import RECONSTRUCTED, REFINED, TRUE_CLOUD, TRUTH
from stages.shared.statistics.method_notes import MeasuredWeights
from stages.shared.statistics.tasks import PREDICTION, TRANSITION
from stages.shared.statistics.window_seeds import window_seed
from stages.shared.statistics.windows import Task, Window
from stages.shared.weights.shipped import CONFIDENCE_NAME, named_source, parts_of, weights_folder

PARTS = ("ae", "lms", "train-ae", "train-lms")


class Made(NamedTuple):
    """Filled windows: positions (B, T, J, 3) and quaternions (B, T, J, 4); for a model also (B, T, J), True where it
    kept the plain interpolation."""

    positions: np.ndarray
    rotations: np.ndarray
    fell_back: np.ndarray | None = None


@dataclass(frozen=True)
class Method:
    """A row of the tables.

    fill: called with a batch and `advance`, which it calls after every window.
    """

    name: str
    fill: Callable[[WindowBatch, Poses, Callable[[], None]], Made]


@dataclass(frozen=True)
class LoadedWeights:
    """Weights as the user named them."""

    name: str
    source: str
    models: Models

    @property
    def windows(self) -> tuple[int, ...]:
        """Frames of the windows that the networks fill at once."""
        return tuple(self.models.windows)

    def artefacts(self) -> list[Path]:
        """The checkpoints of the weights."""
        folder = weights_folder(self.source)
        return [folder / part for part in PARTS if (folder / part / MANIFEST_NAME).is_file()]

    def facts(self) -> MeasuredWeights:
        """The page's note on them; the data are those of the synthesiser's last training."""
        folder = weights_folder(self.source)
        parts = [read_checkpoint(part, optimiser=False) for part in parts_of(folder)]  # autoencoder, synthesiser
        minutes = [each.trainings[-1].minutes for each in parts if each.trainings]
        digests = {path.name: open_artefact(path).manifest.digest for path in self.artefacts()}
        if (folder / CONFIDENCE_NAME).is_file():
            digests["confidence"] = sha256_of_file(folder / CONFIDENCE_NAME)
        return MeasuredWeights(
            name=self.name,
            source=self.source,
            data=last_data(parts[1].trainings),
            digests=digests,
            minutes=sum(minutes) if len(minutes) == len(parts) else None,
        )

    def trained_on(self) -> list[TrainingData]:
        """The data of all trainings of its networks and of the weights that they started from. Raises InputError if a
        checkpoint does not list them."""
        found: list[TrainingData] = []
        for path in self.artefacts():
            data = [each.data for each in read_checkpoint(path, optimiser=False).trainings]
            known = [each for each in data if each is not None]
            if not known or len(known) < len(data):
                raise InputError(
                    f"The weights {self.name} do not say what they were trained on.",
                    "Leave --unseen away, and choose the clips with --where.",
                )
            found += known
        return found


Loaded = LoadedWeights | LoadedInterpolator | LoadedConcepts


def methods_for(task: Task, loaded: Sequence[Loaded], config: Config, refiner: Refiner | None = None) -> list[Method]:
    """All methods of a task's table, the plain ones first."""
    plain = PREDICTION_BASELINES if task.name == PREDICTION else BASELINES
    if config.protocol == "lafan1" and task.name == TRANSITION:
        plain = {**plain, "zero-velocity": zero_velocity}  # that benchmark's other row
    methods = [Method(name, _plain_fill(function)) for name, function in plain.items() if config.plain]
    options = FillOptions(foot_lock=config.foot_lock)
    methods += [
        Method(w.name, _interpolator_fill(w))
        if isinstance(w, LoadedInterpolator)
        else Method(w.name, _concept_fill(w, options))
        if isinstance(w, LoadedConcepts)
        else Method(w.name, _cloud_fill(partial(_synthesised, w.models), config, options))
        for w in loaded
    ]
    if refiner is not None:
        methods += [
            Method(w.name + REFINED, _cloud_fill(partial(_synthesised, w.models), config, options, refiner.refined))
            for w in loaded
            if isinstance(w, LoadedWeights)
        ]
    if config.breakdown:
        methods += [
            Method(w.name + RECONSTRUCTED, _cloud_fill(partial(ReconstructedClouds, w.models), config))
            for w in loaded
            if isinstance(w, LoadedWeights)
        ]
        methods.append(Method(TRUE_CLOUD, _cloud_fill(TrueClouds, config)))
    return methods


def load_all(config: Config) -> list[Loaded]:
    """Load each of `config.weights`. Raises UsageError if two methods would have the same name."""
    taken = {*BASELINES, *PREDICTION_BASELINES, TRUE_CLOUD, TRUTH}
    loaded: list[Loaded] = []
    for text in config.weights:
        name, source = named_source(text)
        if name in taken:
            raise UsageError(f"Two methods are called {name!r}.", f"Give another name: --weights NAME={source}.")
        taken |= {name, name + RECONSTRUCTED, name + REFINED}
        network = network_of(source)
        if is_interpolator(network):
            loaded.append(loaded_interpolator(name, source, config.device))
        elif is_concepts(network):
            loaded.append(LoadedConcepts(name, source, load_concepts(Path(source), config.device)))
        else:
            loaded.append(LoadedWeights(name, source, load_weights(source, config.device)))
    return loaded


def without_answers(motion: Motion, known: np.ndarray) -> Motion:
    """The motion with arbitrary values in every unknown row, so that the truth cannot leak into the filling."""
    rotations, roots, tracks = (np.array(a) for a in (motion.rotations, motion.root_positions, motion.tracks))
    rotations[~known] = [0, 0, 0, 1]
    roots[~known] = 0
    tracks[~known] = 0
    return replace(motion, rotations=rotations, root_positions=roots, tracks=tracks)


def _plain_fill(function: Callable[[Poses, np.ndarray], Filled]):
    def fill(batch: WindowBatch, poses: Poses, advance: Callable[[], None]) -> Made:
        filled = function(poses, batch.known)
        for _ in batch.windows:
            advance()
        return Made(*filled)

    return fill


def _interpolator_fill(loaded: LoadedInterpolator):
    def fill(batch: WindowBatch, poses: Poses, advance: Callable[[], None]) -> Made:
        return Made(*loaded.fill(batch, poses, advance))

    return fill


def _synthesised(models: Models, motion: Motion) -> CloudSource:
    """The true motion is not used."""
    return SynthesisedClouds(models)


def _concept_fill(loaded: LoadedConcepts, options: FillOptions):
    def fill(batch: WindowBatch, poses: Poses, advance: Callable[[], None]) -> Made:
        motions = []
        for motion in batch.motions:
            motions.append(loaded.fill(batch, without_answers(motion, batch.known), options))
            advance()
        result = Poses.of(batch.skeleton, motions)
        return Made(result.positions.numpy(), result.rotations.numpy())

    return fill


def _cloud_fill(
    source_of: Callable[[Motion], CloudSource],
    config: Config,
    options: FillOptions | None = None,
    refined: Callable[[WindowBatch, Window, Motion], Motion] | None = None,
):
    """Fill from the clouds that a source finds; `source_of` is called with each window's true motion, and `refined`
    with each filled one."""
    device = choose_device(config.device)

    def fill(batch: WindowBatch, poses: Poses, advance: Callable[[], None]) -> Made:
        motions, fell_back = [], []
        for window, motion in zip(batch.windows, batch.motions, strict=True):
            filled = fill_motion(
                batch.skeleton,
                without_answers(motion, batch.known),
                batch.known,
                source_of(motion),
                points=config.points,
                seed=window_seed(config.seed, window.clip, window.start),
                device=device,
                options=options,
            )
            made = filled.motion
            motions.append(made if refined is None else refined(batch, window, made))
            fell_back.append(filled.plain)
            advance()
        result = Poses.of(batch.skeleton, motions)
        return Made(result.positions.numpy(), result.rotations.numpy(), np.stack(fell_back))

    return fill
