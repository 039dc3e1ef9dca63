"""Keys of a motion, and junk between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from data_schemas.skeleton import Motion


def keys_every(frames: int, step: int) -> np.ndarray:
    known = np.zeros(frames, bool)
    known[::step] = True
    known[-1] = True
    return known


def junk(motion: Motion, known: np.ndarray) -> Motion:
    """The motion with NaN wherever no key is: whatever reads it shows."""
    parts = [np.array(part) for part in (motion.rotations, motion.root_positions, motion.tracks)]
    for part in parts:
        if part.shape[0]:
            part[~known] = np.nan
    return replace(motion, rotations=parts[0], root_positions=parts[1], tracks=parts[2])
