"""The files of an unfinished training, from which a run that was killed at any instant can be resumed.

    NAME.partial/checkpoints/step_000002000/   a checkpoint artefact each, the newest few
    NAME.partial/log/step_000002340.parquet    rows of the log since the newest checkpoint
    NAME.partial/windows/                      files of the training itself (`train lms --reuse`)
    NAME.partial/.made-by-pumps                the marker without which pumps does not write or remove the folder

Each checkpoint is an artefact of its own that appears whole or not at all; old ones are removed after a new one is
written.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from data_schemas.artefact import open_artefact, partial_folder, write_artefact
from data_schemas.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from data_schemas.disk import disk_faults_reported
from data_schemas.errors import InputError
from data_schemas.manifest import MANIFEST_NAME
from data_schemas.own_folders import (
    is_own_folder,
    make_own_folder,
    mark_own_folder,
    refuse_unmarked,
    remove_own_folder,
)
from stages.shared.networks.layers.layer_stack import GrowingLayer
from stages.shared.progress import Progress
from stages.shared.training.config import TrainingConfig

# Settings that may change when a run is resumed: the result is the same except for rounding.
_FREE = {
    "output", "device", "max_time", "minutes", "tensorboard", "checkpoint_every", "keep_checkpoints",
    "keep_optimiser", "workers", "cache_mb", "accumulate", "activation_checkpointing",
}  # fmt: skip


@dataclass
class Place:
    """Progress of a training: steps done, the best validation score and its step, validations since then without
    improvement, and seconds of training."""

    step: int = 0
    best: float = float("inf")
    best_step: int = 0
    stale: int = 0
    seconds: float = 0.0


class Unfinished:
    """The checkpoints of one unfinished training."""

    def __init__(self, config: TrainingConfig):
        self.config = config
        self.folder = partial_folder(config.output)
        self._checkpoints = self.folder / "checkpoints"
        settings = config.model_dump(mode="json")
        self._by_path = {name: value for name, value in settings.items() if name not in _FREE}
        # Training data are compared by digest: moved data can be resumed, replaced data cannot.
        self._settings = self._by_path | {
            name: found for name in self._by_path if (found := _digest(getattr(config, name))) is not None
        }
        defaults = type(config).model_construct().model_dump(mode="json", warnings=False)
        self._defaults = {name: value for name, value in defaults.items() if name in self._settings}

    @property
    def digest(self) -> str:
        """Digest of the settings; the files beside the checkpoints are used by trainings with equal settings only."""
        return hashlib.sha256(json.dumps(self._settings, sort_keys=True).encode()).hexdigest()[:16]

    @property
    def log_folder(self) -> Path:
        return self.folder / "log"

    @property
    def begun(self) -> bool:
        """Whether there is a checkpoint from which the training can go on."""
        return bool(self._newest_first())

    def claim(self) -> None:
        """Make the folder and mark it, before anything is written into it.

        Raises: UsageError if a folder of this name is there that pumps did not make.
        """
        with disk_faults_reported(self.folder):
            if self.begun:
                mark_own_folder(self.folder)  # of an older pumps, which did not mark it
            else:
                make_own_folder(self.folder)

    def release(self) -> None:
        """Remove the folder if it holds no checkpoint: such a training starts from the beginning anyway."""
        if is_own_folder(self.folder) and not self.begun:
            self.forget()

    def keep(
        self,
        place: Place,
        weights: Mapping[str, Tensor],
        training: Mapping[str, Tensor],
        log: Sequence[Mapping[str, Any]],
    ) -> None:
        """Write a checkpoint of the weights and of the training's own arrays; remove the oldest."""
        with write_artefact(
            self._checkpoints / f"step_{place.step:09d}", "checkpoint", stage="training", config=self._settings
        ) as draft:
            write_checkpoint(
                draft.folder,
                weights=arrays_of(weights),
                config={"training": self._settings, "place": asdict(place)},
                optimiser=arrays_of(training),
                log=log,
                card="Unfinished training; `pumps train` resumes it.\n",
            )
        for old in self._newest_first()[self.config.keep_checkpoints :]:
            shutil.rmtree(old, ignore_errors=True)

    def newest(self, progress: Progress) -> Checkpoint | None:
        """The newest complete checkpoint; None if there is none, or the settings differ."""
        for path in self._newest_first():
            try:
                kept = read_checkpoint(path)
            except InputError as error:
                progress.message(f"{error.message} Trying the checkpoint before it.")
                continue
            # A setting that an older pumps did not have takes its default.
            before = {**self._defaults, **kept.config.get("training", {})}
            # Checkpoints of an older pumps have paths.
            if before in (self._settings, self._by_path) and kept.optimiser is not None:
                return kept
            others = sorted(
                name for name in before.keys() | self._settings.keys() if before.get(name) != self._settings.get(name)
            )
            aside = self._set_aside()
            progress.message(
                f"{self.folder.name} was made with other settings ({', '.join(others)}); it is kept as {aside.name}, "
                "and training is starting afresh."
            )
            return None
        return None

    def _set_aside(self) -> Path:
        """Move the folder aside, where no training reads it, replacing a folder that was moved aside before."""
        aside = self.folder.with_name(f"{self.config.output.name}.set-aside")
        refuse_unmarked(aside)
        remove_own_folder(aside)
        self.folder.rename(aside)
        self.claim()
        return aside

    def forget(self) -> None:
        """Remove the folder, if pumps made it."""
        remove_own_folder(self.folder)

    def _newest_first(self) -> list[Path]:
        # A folder without a manifest is a checkpoint whose write was killed.
        return sorted((path.parent for path in self._checkpoints.glob("step_*/manifest.json")), reverse=True)


def _digest(value: Any) -> str | None:
    """The digest of the artefact to which a setting refers; None for other settings."""
    if not isinstance(value, Path) or not (value / MANIFEST_NAME).is_file():
        return None
    return open_artefact(value).manifest.digest


def arrays_of(tensors: Mapping[str, Tensor]) -> dict[str, np.ndarray]:
    """Copies of the arrays in NumPy."""
    return {name: value.detach().cpu().numpy() for name, value in tensors.items()}


def set_weights(networks: nn.Module, arrays: Mapping[str, np.ndarray], *, source: Path) -> list[str]:
    """Load a checkpoint's weights into the networks; returns the names of weights that the checkpoint lacks.

    These keep their values, except that a layer that is entirely new begins as the identity if it can, so that a
    deepened network has the same output at first.

    Raises: InputError if the checkpoint holds weights that do not match these networks.
    """
    own = networks.state_dict()
    for name, value in arrays.items():
        if name not in own or tuple(own[name].shape) != value.shape:
            wanted = f"the shape {tuple(own[name].shape)}" if name in own else "none of that name"
            raise InputError(
                f"{source} has weights {name} of the shape {value.shape}, but this network has {wanted}.",
                "Train with the sizes that it was trained with.",
            )
    networks.load_state_dict(
        {name: torch.from_numpy(np.array(value)).to(own[name].dtype) for name, value in arrays.items()}, strict=False
    )
    fresh = [name for name in own if name not in arrays]
    for name, module in networks.named_modules():
        if isinstance(module, GrowingLayer) and not any(key.startswith(f"{name}.") for key in arrays):
            module.begin_as_identity()
    return fresh
