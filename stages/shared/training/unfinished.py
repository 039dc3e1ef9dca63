"""What an unfinished training keeps on the disk, so that a run killed at any instant goes on from it.

    NAME.partial/checkpoints/step_000002000/   a checkpoint artefact each, the newest few
    NAME.partial/log/step_000002340.parquet    rows of the log since the newest checkpoint
    NAME.partial/windows/                      what a training keeps of its own (`train lms --reuse`)

Each checkpoint is an artefact of its own that appears whole or not at all; older ones go when a newer one is there.
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
from data_schemas.errors import InputError
from data_schemas.manifest import MANIFEST_NAME
from stages.shared.networks.layers.layer_stack import GrowingLayer
from stages.shared.progress import Progress
from stages.shared.training.config import TrainingConfig

# May differ when a run goes on: what is learnt is the same, but for rounding.
_FREE = {
    "output", "device", "max_time", "minutes", "tensorboard", "checkpoint_every", "keep_checkpoints",
    "keep_optimiser", "workers", "cache_mb", "accumulate", "activation_checkpointing",
}  # fmt: skip


@dataclass
class Place:
    """How far a training has come: steps done, the best validation score and when it was, validations since without
    gain, and seconds of training."""

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
        # What is learnt from is told by its content: the same elsewhere goes on, another in its place does not.
        self._settings = self._by_path | {
            name: found for name in self._by_path if (found := _digest(getattr(config, name))) is not None
        }
        defaults = type(config).model_construct().model_dump(mode="json", warnings=False)
        self._defaults = {name: value for name, value in defaults.items() if name in self._settings}

    @property
    def digest(self) -> str:
        """Of the settings: what is kept beside the checkpoints serves trainings with the same alone."""
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
        """Write a checkpoint of the weights and of the training's own arrays; forget the oldest."""
        with write_artefact(
            self._checkpoints / f"step_{place.step:09d}", "checkpoint", stage="training", config=self._settings
        ) as draft:
            write_checkpoint(
                draft.folder,
                weights=arrays_of(weights),
                config={"training": self._settings, "place": asdict(place)},
                optimiser=arrays_of(training),
                log=log,
                card="Unfinished training; `pumps train` goes on from it.\n",
            )
        for old in self._newest_first()[self.config.keep_checkpoints :]:
            shutil.rmtree(old, ignore_errors=True)

    def newest(self, progress: Progress) -> Checkpoint | None:
        """The newest checkpoint that is whole; None where there is none, or the settings were others."""
        for path in self._newest_first():
            try:
                kept = read_checkpoint(path)
            except InputError as error:
                progress.message(f"{error.message} Trying the checkpoint before it.")
                continue
            # A setting that an older pumps did not have is what it is by default.
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
        """Move it all to where a training with its own settings would not look, over what was there before."""
        aside = self.folder.with_name(f"{self.config.output.name}.set-aside")
        shutil.rmtree(aside, ignore_errors=True)
        self.folder.rename(aside)
        return aside

    def forget(self) -> None:
        """Remove it all."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _newest_first(self) -> list[Path]:
        # A folder without a manifest is a checkpoint that a kill left half written.
        return sorted((path.parent for path in self._checkpoints.glob("step_*/manifest.json")), reverse=True)


def _digest(value: Any) -> str | None:
    """The digest of the artefact that a setting names; None for other settings."""
    if not isinstance(value, Path) or not (value / MANIFEST_NAME).is_file():
        return None
    return open_artefact(value).manifest.digest


def arrays_of(tensors: Mapping[str, Tensor]) -> dict[str, np.ndarray]:
    """Copies in NumPy."""
    return {name: value.detach().cpu().numpy() for name, value in tensors.items()}


def set_weights(networks: nn.Module, arrays: Mapping[str, np.ndarray], *, source: Path) -> list[str]:
    """Give the networks the weights of a checkpoint; those it does not name stay as they are, and are returned.

    Layers that are new from end to end begin as the identity where they can, so that networks grown deeper do at
    first what they did.

    Raises: InputError where it holds weights that these networks have no place for.
    """
    own = networks.state_dict()
    for name, value in arrays.items():
        if name not in own or tuple(own[name].shape) != value.shape:
            wanted = f"the shape {tuple(own[name].shape)}" if name in own else "none of that name"
            raise InputError(
                f"{source} has weights {name} of the shape {value.shape}, and this network has {wanted}.",
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
