"""Masks of known frames for the three masked tasks (PUMPS 3.3, 4.2)."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from stages.shared.training.task import rows_of


def draw_known(lengths: Tensor, window: int, longest_gap: int, rng: np.random.Generator) -> Tensor:
    """A mask for each window, True = known: keyframe interpolation, transition or prediction.

    Six windows of ten are for interpolation, with the first and last frame known: half of them have a random number
    of keys, between a twenty-fourth and a quarter of the frames (5 to 32 of 128), the other half evenly spaced keys,
    as animators set them. Transition and prediction mask 10 to `longest_gap` consecutive frames, never all frames.

    Args:
        lengths: (B,) real frames of each window, at least 4.
        rng: each window's mask is drawn from its own generator (`rows_of`).

    Returns: (B, window) bool, False beyond each length.
    """
    known = torch.zeros(len(lengths), window, dtype=torch.bool)
    for row, (length, own) in enumerate(zip(lengths.tolist(), rows_of(rng, len(lengths)), strict=True)):
        kind = own.uniform()
        if kind < 0.6:
            known[row, torch.from_numpy(draw_keys(length, own))] = True
            continue
        known[row, :length] = True
        gap = int(own.integers(min(10, length - 3), min(longest_gap, length - 3) + 1))
        if kind < 0.85:
            start = int(own.integers(1, length - gap))
            known[row, start : start + gap] = False
        else:
            known[row, length - gap : length] = False
    return known


def draw_keys(length: int, rng: np.random.Generator) -> np.ndarray:
    """Indices of the keys of one interpolation window of `length` frames, including the first and last frame."""
    least, most = max(2, round(length / 24)), max(3, round(length / 4))
    if rng.uniform() < 0.5:
        # Uniform in the logarithm of the interval, so that long gaps are not too rare.
        every = int(np.exp(rng.uniform(np.log(3), np.log(min(40, length)))))
        inner = np.arange(int(rng.integers(0, every)), length, every)
    else:
        count = int(rng.integers(least, most + 1))
        inner = rng.choice(np.arange(1, length - 1), size=min(count, length) - 2, replace=False)
    return np.unique(np.concatenate([[0, length - 1], inner]))
