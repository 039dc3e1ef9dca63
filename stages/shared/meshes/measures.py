"""Measures of predicted meshes (SpecTrHuMS 4.3 and 4.6.3).

T frames, N vertices, E edges, K joints; metres in, the unit of the result in each name.
"""

from __future__ import annotations

import numpy as np


def edge_lengths(vertices: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Lengths (..., E) of edges (E, 2) in meshes (..., N, 3)."""
    return np.linalg.norm(vertices[..., edges[:, 0], :] - vertices[..., edges[:, 1], :], axis=-1)


def melv_mm(vertices: np.ndarray, last_known: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Mean edge length variation (T,), millimetres: |length in a frame - length in the last known frame|, over edges.

    It compares a prediction with the mesh it starts from, not with the truth (SpecTrHuMS 4.3).

    Args:
        vertices: (T, N, 3) predicted meshes. last_known: (N, 3). edges: (E, 2).
    """
    still = edge_lengths(last_known, edges)
    return np.array([1e3 * np.abs(edge_lengths(frame, edges) - still).mean() for frame in vertices])


def box_diagonal(vertices: np.ndarray) -> np.ndarray:
    """Length (...,) of the diagonal of the axis-aligned bounding box of meshes (..., N, 3)."""
    return np.linalg.norm(vertices.max(axis=-2) - vertices.min(axis=-2), axis=-1)


def rmse_share(predicted: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Root mean square error over coordinates of vertices (T,), as a share of the sequence's largest bounding box.

    Args:
        predicted, true: (T, N, 3) metres; the box is the true sequence's largest diagonal (Table 4).
    """
    error = np.sqrt(((predicted - true) ** 2).mean(axis=(-2, -1)))
    return error / box_diagonal(true).max()


def mpjpe_mm(predicted: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Mean joint position error (...,) in millimetres of joints (..., K, 3)."""
    return 1e3 * np.linalg.norm(predicted - true, axis=-1).mean(axis=-1)


def averaged_until(values: np.ndarray) -> np.ndarray:
    """Mean of the first 1, 2, ... T values (..., T): the averages up to each time of Table 2."""
    return np.cumsum(values, axis=-1) / np.arange(1, values.shape[-1] + 1)
