"""Windows of coefficients and joints for a training, read from the artefact when they are needed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from data_schemas.errors import InputError
from data_schemas.mesh import MeshReader
from stages.shared.meshes.linear_views import LinearView
from stages.shared.meshes.spectral_basis import SpectralBasis
from stages.shared.meshes.windows import MeshWindow, WindowList
from stages.shared.training.task import RowRandom

_VALIDATION_WINDOWS = 48
_STATISTICS_WINDOWS = 64


@dataclass(frozen=True)
class MeshWindows:
    """The views of an artefact, and its windows for training and validation.

    coefficients: None for a training on joints alone. joints: None for meshes without joints.
    """

    coefficients: LinearView | None
    joints: LinearView | None
    training: WindowList
    held_back: WindowList

    def statistics(self, seed: int) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation (k, 3) of the coefficients of some training windows, metres."""
        assert self.coefficients is not None
        chosen = np.random.default_rng((seed, 7)).integers(len(self.training), size=_STATISTICS_WINDOWS)
        values = np.concatenate([_read(self.coefficients, self.training[int(index)]) for index in chosen])
        values = values.astype(np.float64)
        return torch.from_numpy(values.mean(0)).float(), torch.from_numpy(values.std(0)).float()

    def validation(self) -> list[MeshWindow]:
        """Windows for validation, evenly spread over the held-back clips."""
        return self.held_back.spread(_VALIDATION_WINDOWS)


def mesh_windows(reader: MeshReader, basis: SpectralBasis | None, frames: int, stride: int) -> MeshWindows:
    """The windows of an artefact; without validation clips, the training clips are used for both.

    Raises: InputError if no training clip is long enough.
    """
    rows = {split: [row for row in reader.clips if row.split == split] for split in ("train", "val")}
    if not rows["train"]:
        raise InputError(f"{reader.artefact.path} has no training clips.", "Give --splits to `pumps ingest`.")
    training = WindowList(rows["train"], frames, stride)
    try:
        held_back = WindowList(rows["val"], frames, stride)
    except InputError:
        held_back = training
    regressor = reader.topology.joints
    return MeshWindows(
        LinearView(reader, basis.vectors.T) if basis is not None else None,
        LinearView(reader, regressor.matrix(reader.topology.count)) if regressor.names else None,
        training,
        held_back,
    )


class WindowDrawer:
    """Draws windows of one view, all equally often: (B, T, M, 3) metres."""

    def __init__(self, view: LinearView, windows: WindowList):
        self.view, self.windows = view, windows

    def draw(self, rng: RowRandom) -> Tensor:
        chosen = [self.windows[int(row.integers(len(self.windows)))] for row in rng.rows]
        return torch.from_numpy(np.stack([_read(self.view, window) for window in chosen]))


def _read(view: LinearView, window: MeshWindow) -> np.ndarray:
    return view.window(window.clip, window.start, window.stop)


def stacked(view: LinearView, windows: list[MeshWindow]) -> Tensor:
    """Windows (B, T, M, 3) of a view, metres."""
    return torch.from_numpy(np.stack([_read(view, window) for window in windows]))
