"""The clouds that are decoded: of latents, or as a tpc artefact has them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from data_schemas.errors import InputError
from data_schemas.latent import ClipRow, LatentReader
from data_schemas.skeleton import BODY_GROUPS
from stages.shared.kinematics.conventions import MODEL_FPS

# Points of each body group where no skeleton says how long its bones are: shares of a human body's bone lengths.
GROUP_SHARES = (0.16, 0.155, 0.155, 0.265, 0.265)


def group_counts(points: int) -> np.ndarray:
    """(P,) int64 body groups of `points` points, in the shares of a human body, as whole numbers."""
    edges = np.rint(np.cumsum(GROUP_SHARES) / sum(GROUP_SHARES) * points).astype(np.int64)
    return np.repeat(np.arange(len(BODY_GROUPS)), np.diff(edges, prepend=0))


def latents_of(reader: LatentReader, row: ClipRow) -> tuple[Tensor, Tensor, Tensor]:
    """Latents (T, D), centroids (T, 3) and times (T,) in model frames."""
    latents, centroids = reader.latents(row.clip)
    times = torch.arange(row.frames, dtype=torch.float64) * (MODEL_FPS / row.fps)
    return torch.from_numpy(latents), torch.from_numpy(centroids), times


def chosen_rows(clips: Iterable[ClipRow], splits: Sequence[str], path: Path | None) -> list[ClipRow]:
    """The clips of some splits. Raises InputError where there is none."""
    rows = list(clips)
    chosen = [row for row in rows if row.split in splits]
    if not chosen:
        found = ", ".join(sorted({row.split for row in rows})) or "none"
        raise InputError(f"{path} has no clip in the splits {', '.join(splits)}; it has {found}.", "Give --splits.")
    return chosen
