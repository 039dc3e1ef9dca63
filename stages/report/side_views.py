"""The player's scenes seen from the side, for pictures: points, the gap to show, and the direction to look in."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

MILLIMETRES = 1000.0


def shown_gap(points: np.ndarray, keys: Sequence[int]) -> tuple[int, int]:
    """The pair of neighbouring keys between which points (T, N, 3) travel furthest, a frame at least between them."""
    travelled = np.linalg.norm(np.diff(points, axis=0), axis=-1).mean(axis=1)
    gaps = [(a, b) for a, b in pairwise(keys) if b - a > 1]
    if not gaps:
        return 0, len(points) - 1
    return max(gaps, key=lambda gap: travelled[gap[0] : gap[1]].sum())


def points_of(motion: dict) -> np.ndarray:
    """(T, N, 3) metres of a packed motion."""
    raw = np.frombuffer(base64.b64decode(motion["points"]), "<i2").astype(np.float64)
    return raw.reshape(motion["frames"], motion["nodes"], 3) * motion["scale"]


def frames_at(truth: dict, motion: dict, frames: np.ndarray) -> np.ndarray:
    """The frames of a motion, which may have another rate, at the times of these frames of the truth."""
    return np.clip((frames / truth["fps"] * motion["fps"]).round().astype(int), 0, motion["frames"] - 1)


def distance_note(truth: dict, motion: dict, frames: Sequence[int] | np.ndarray) -> str:
    """ "NAME: N mm from TRUTH", a mean over these frames; the name alone where the points are others, or no frame is
    given."""
    true, made = points_of(truth), points_of(motion)
    if made.shape != true.shape or not len(frames):
        return motion["name"]
    apart = np.linalg.norm(made[frames] - true[frames], axis=-1).mean()
    return f"{motion['name']}: {MILLIMETRES * apart:.0f} mm from {truth['name']}"


def ground_of(points: np.ndarray, root: int) -> np.ndarray:
    """(T, 1, 3) the pelvis' place on the ground."""
    return points[:, root, None] * [1.0, 0.0, 1.0]


def side_view(points: np.ndarray, root: int) -> np.ndarray:
    """(3, 2) from the world to the picture: along the horizontal line on which the body spreads most."""
    spread = (points - ground_of(points, root))[..., [0, 2]].reshape(-1, 2)
    _, axes = np.linalg.eigh(spread.T @ spread)
    along = axes[:, -1] * (1 if axes[:, -1] @ (points[-1, root] - points[0, root])[[0, 2]] >= 0 else -1)
    return np.array([[along[0], 0.0], [0.0, 1.0], [along[1], 0.0]])
