"""The files of an unfinished training, from which a run that was killed at any instant can be resumed.

    NAME.partial/checkpoints/step_000002000/   a checkpoint artefact each, the newest few
    NAME.partial/log/step_000002340.parquet    rows of the log since the newest checkpoint
    NAME.partial/windows/                      files of the training itself (`train lms --reuse`)

Each checkpoint is an artefact of its own that appears whole or not at all; old ones are removed after a new one is
written. A folder NAME.partial that holds anything else is refused, and nothing in it is removed.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from data_schemas.artefact import open_artefact, partial_folder, write_artefact
from data_schemas.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import MANIFEST_NAME
from stages.shared.networks.layers.layer_stack import GrowingLayer
from stages.shared.progress import Progress
from stages.shared.training.config import TrainingConfig

_PARTS = {"checkpoints": "step_", "log": "step_", "windows": ""}  # folder -> how the names of what is in it begin

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
    """The checkpoints of one unfinished training.

    Raises: UsageError if the folder NAME.partial holds anything that is not a training's.
    """

    def __init__(self, config: TrainingConfig):
        self.config = config
        self.folder = partial_folder(config.output)
        foreign = _foreign(self.folder)
        if foreign is not None:
            raise UsageError(
                f"{foreign} is not of an unfinished training, which is kept in {self.folder}.",
                "Move it, or give another name for the output.",
            )
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
        """Move the folder aside, where no training reads it, replacing a training that was moved aside before."""
        first = aside = self.folder.with_name(f"{self.config.output.name}.set-aside")
        count = 1
        while os.path.lexists(aside) and (aside.is_symlink() or _foreign(aside) is not None):
            count += 1
            aside = first.with_name(f"{first.name}-{count}")
        shutil.rmtree(aside, ignore_errors=True)
        self.folder.rename(aside)
        return aside

    def forget(self) -> None:
        """Remove what the training kept, and the folder if nothing else is in it."""
        for name in _PARTS:
            shutil.rmtree(self.folder / name, ignore_errors=True)
        with suppress(OSError):
            self.folder.rmdir()

    def _newest_first(self) -> list[Path]:
        # A folder without a manifest is a checkpoint whose write was killed.
        return sorted((path.parent for path in self._checkpoints.glob("step_*/manifest.json")), reverse=True)


def _foreign(folder: Path) -> Path | None:
    """Something in the folder that no training put there, or the folder itself if it is a file; else None."""
    if not folder.is_dir():
        return folder if os.path.lexists(folder) else None
    for entry in sorted(folder.iterdir()):
        if entry.name not in _PARTS and not entry.name.startswith("."):
            return entry
        inside = sorted(entry.iterdir()) if entry.name in _PARTS and entry.is_dir() else []
        begins = _PARTS.get(entry.name, "")
        strange = [each for each in inside if not each.name.startswith((begins, "."))]
        if strange:
            return strange[0]
    return None


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
