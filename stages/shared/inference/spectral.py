"""Trained networks of mesh sequences in use: prediction of any length, and completion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from data_schemas.checkpoint import LAST, read_checkpoint
from data_schemas.errors import InputError
from data_schemas.manifest import Artefact, open_artefact
from stages.shared.inference.bounded_network import build_bounded, whole_setting
from stages.shared.inference.models import load_state
from stages.shared.meshes.spectral_basis import SpectralBasis
from stages.shared.networks.layers.device import choose_device
from stages.shared.networks.layers.sizes import JointMlpSizes, SpectralSizes
from stages.shared.networks.spectral.joint_mlp import JointMlp
from stages.shared.networks.spectral.spectral_model import SpectralModel

_MOST = 100_000  # frames, or eigenvectors


@dataclass(frozen=True)
class SpectralWeights:
    """A trained SpecTrHuMS with its basis.

    task: "predict" or "complete". frames: of a window; known: its first frames that are known.
    connectivity: digest of the meshes that it was trained on. fps: their rates.
    """

    artefact: Artefact
    model: SpectralModel
    basis: SpectralBasis
    task: str
    frames: int
    known: int
    connectivity: str
    fps: tuple[float, ...]

    def predict(self, known: np.ndarray, count: int) -> np.ndarray:
        """The next `count` frames of coefficients (B, count, k, 3) metres.

        More frames than a window has are predicted in turns, each from the last known and predicted ones (4.6.1).

        Args:
            known: (B, T, k, 3), of which the last `self.known` are read.
        Raises: InputError for weights of another task, or fewer known frames than the weights need.
        """
        self.check_task("predict")
        if known.shape[1] < self.known:
            raise InputError(
                f"{known.shape[1]} frames are known, and these weights predict from {self.known}.",
                "Give a longer sequence.",
            )
        context, made = known[:, -self.known :], []
        while sum(part.shape[1] for part in made) < count:
            made.append(self._run(context)[:, self.known :])
            context = np.concatenate([context, made[-1]], axis=1)[:, -self.known :]
        return np.concatenate(made, axis=1)[:, :count]

    def complete(self, window: np.ndarray) -> np.ndarray:
        """The unknown frames (B, frames - known - 1, k, 3) of a window whose first frames and last frame are known.

        Args:
            window: (B, frames, k, 3), of which the unknown frames are not read.
        Raises: InputError for weights of another task, or a window of another length.
        """
        self.check_task("complete")
        if window.shape[1] != self.frames:
            raise InputError(f"A window of {window.shape[1]} frames is given, and these weights take {self.frames}.")
        given = window.copy()
        given[:, self.known : -1] = given[:, [self.known - 1]]
        return self._run(given)[:, self.known : -1]

    def check_task(self, task: str) -> None:
        """Raise InputError unless the weights were trained for this task."""
        if task != self.task:
            raise InputError(
                f"{self.artefact.path} was trained to {self.task}, and weights that {task} are needed.",
                f"Train with --task {task}.",
            )

    def _run(self, windows: np.ndarray) -> np.ndarray:
        device = next(self.model.parameters()).device
        with torch.no_grad():
            return self.model(torch.from_numpy(windows).float().to(device)).cpu().numpy()


def load_spectral(path: str | Path, device: str = "auto", *, last: bool = False) -> SpectralWeights:
    """Load what `pumps train spectral --method spectral` trained.

    Args:
        last: take the last weights of a training that kept both, instead of its best ones.

    Raises: InputError for another kind of checkpoint, a damaged one, or one without the last weights beside others.
    """
    artefact = open_artefact(path, "checkpoint")
    kept = read_checkpoint(artefact, optimiser=False)
    config = _config_of(kept.config, path, "spectral", ("eigenvectors", "window", "known", "task", "connectivity"))
    weights = _chosen(kept.weights, path, last)
    if "basis.vectors" not in weights or "basis.values" not in weights:
        raise InputError(f"{path} is damaged: it has no spectral basis.")
    vectors, values = weights.pop("basis.vectors"), weights.pop("basis.values")
    count = whole_setting(config, "eigenvectors", _MOST, path)
    if vectors.ndim != 2 or vectors.shape[1] != count or values.shape != (count,):
        raise InputError(f"{path} is damaged: its spectral basis has the shape {vectors.shape}.")
    basis = SpectralBasis(values.astype(np.float64), vectors, str(config["connectivity"]))
    frames = whole_setting(config, "window", _MOST, path)
    known, task = whole_setting(config, "known", frames - 1, path), str(config["task"])
    model = build_bounded(
        lambda: SpectralModel(count, frames, known, task == "complete", SpectralSizes(**config["sizes"])),
        config["sizes"],
        weights,
        path,
    )
    load_state(model, weights, path)
    model.to(choose_device(device)).eval()
    return SpectralWeights(artefact, model, basis, task, frames, known, basis.digest, _rates(config))


@dataclass(frozen=True)
class JointWeights:
    """A trained siMLPe: known joints (B, T, K, 3) to the next `ahead` frames."""

    model: JointMlp
    known: int
    ahead: int
    connectivity: str

    def predict(self, known: np.ndarray) -> np.ndarray:
        """(B, ahead, K, 3) metres, from the last `self.known` frames of (B, T, K, 3)."""
        device = next(self.model.parameters()).device
        with torch.no_grad():
            return self.model(torch.from_numpy(known[:, -self.known :]).float().to(device)).cpu().numpy()


def load_joint_mlp(path: str | Path, device: str = "auto", *, last: bool = False) -> JointWeights:
    """Load what `pumps train spectral --method joints` trained. `last` and errors are those of `load_spectral`."""
    kept = read_checkpoint(open_artefact(path, "checkpoint"), optimiser=False)
    config = _config_of(kept.config, path, "joint-mlp", ("joints", "window", "known", "connectivity"))
    frames = whole_setting(config, "window", _MOST, path)
    known = whole_setting(config, "known", frames - 1, path)
    joints, ahead = len(config["joints"]), frames - known
    weights = _chosen(kept.weights, path, last)
    model = build_bounded(
        lambda: JointMlp(joints, known, ahead, JointMlpSizes(**config["sizes"])), config["sizes"], weights, path
    )
    load_state(model, weights, path)
    model.to(choose_device(device)).eval()
    return JointWeights(model, known, ahead, str(config["connectivity"]))


def is_joint_mlp(path: str | Path) -> bool:
    """Whether a checkpoint is siMLPe's. Raises InputError if it is no checkpoint."""
    return read_checkpoint(open_artefact(path, "checkpoint"), optimiser=False).config.get("network") == "joint-mlp"


def vertices_in_parts(basis: SpectralBasis, coefficients: np.ndarray, frames: int = 64) -> Iterator[np.ndarray]:
    """Vertices (t, N, 3) metres of coefficients (T, k, 3), some frames at a time."""
    for start in range(0, len(coefficients), frames):
        yield basis.vertices(coefficients[start : start + frames]).astype(np.float32, copy=False)


def _chosen(weights: Mapping[str, np.ndarray], path: object, last: bool) -> dict[str, np.ndarray]:
    """The best or the last weights of a checkpoint, with the basis, which both share."""
    if not last:
        return {name: value for name, value in weights.items() if not name.startswith(LAST)}
    found = {name.removeprefix(LAST): value for name, value in weights.items() if name.startswith(LAST)}
    if not found:
        raise InputError(
            f"{path} does not hold the last weights of its training beside the best ones.", "Train with --keep both."
        )
    return {**{name: value for name, value in weights.items() if name.startswith("basis.")}, **found}


def _config_of(config: dict, path: object, network: str, fields: Sequence[str]) -> dict:
    if config.get("network") != network:
        raise InputError(f"{path} does not hold a network of mesh sequences.", "Train one: pumps train spectral.")
    missing = [name for name in ("sizes", *fields) if name not in config]
    if missing:
        raise InputError(f"{path} is damaged: its config lacks {', '.join(missing)}.")
    return config


def _rates(config: dict) -> tuple[float, ...]:
    return tuple(float(rate) for rate in config.get("fps", ()))
