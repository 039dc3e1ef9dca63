"""What a cloth simulation must satisfy, measured on its frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.shared.meshes.measures import edge_lengths
from stages.simulate_cloth.collisions import near_pairs
from stages.simulate_cloth.sheet import Sheet

_GUARD = 3.0  # nearest distances are searched up to this multiple of the thickness


@dataclass(frozen=True)
class ClothChecks:
    """Over all frames of some simulations.

    strain:      greatest relative change of a thread's length between two vertices; strain_99: of 99 in 100.
    shear:       the same of the diagonals, 99 in 100.
    nearest_m:   least distance of two vertices without an edge (a multiple of the thickness at most).
    pin_drift_m: greatest distance of a pinned vertex from its place.
    """

    strain: float
    strain_99: float
    shear: float
    nearest_m: float
    pin_drift_m: float


def check_frames(frames: np.ndarray, sheet: Sheet, pins: np.ndarray, thickness_m: float) -> ClothChecks:
    """Measure places (S, T, N, 3) metres with the pins (S, 2)."""
    strains = np.abs(edge_lengths(frames, sheet.edges) / sheet.lengths - 1)
    _sims, _times, count, _ = frames.shape
    numbers, one, other = near_pairs(frames.reshape(-1, count, 3), _GUARD * thickness_m)
    edges = sheet.edges[:, 0].astype(int) * count + sheet.edges[:, 1]
    free = ~np.isin(one * count + other, edges)
    flat = frames.reshape(-1, count, 3)
    apart = np.linalg.norm(flat[numbers[free], one[free]] - flat[numbers[free], other[free]], axis=1)
    pinned = np.take_along_axis(frames, pins[:, None, :, None], axis=2) - sheet.vertices[pins][:, None]
    return ClothChecks(
        float(strains[..., : sheet.threads].max()),
        float(np.quantile(strains[..., : sheet.threads], 0.99)),
        float(np.quantile(strains[..., sheet.threads :], 0.99)),
        float(apart.min()) if len(apart) else _GUARD * thickness_m,
        float(np.abs(pinned).max()),
    )
