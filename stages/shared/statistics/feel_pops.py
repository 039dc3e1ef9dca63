"""Pops: what a viewer sees in one frame and no mean shows. Each figure is the largest of its window.

A window **twists** where a joint turns further between two frames than `TWIST_DEG`, and more than `TWIST_SHARE` times
as far as any joint of the true window does. It **jolts** where a joint accelerates more than `JOLT_SHARE` times as
much as any joint of the true window. Only what was filled counts: pairs and runs of frames of which at least one was
missing.
"""

from __future__ import annotations

import numpy as np

from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.rotations import angles_between

TWIST_DEG, TWIST_SHARE = 30.0, 1.5
JOLT_SHARE = 2.0
SHIN_RADIUS_SHARE = 0.05  # of the leg's length: two shins whose axes come nearer than this pass through each other
MILLIMETRES = 1000.0


def largest_turn_deg(rotations: np.ndarray, missing: np.ndarray) -> np.ndarray:
    """(B,) the furthest that a joint turns between two neighbouring frames, degrees.

    Args:
        rotations: (B, T, J, 4) global quaternions xyzw. missing: (T,) bool; one frame of a pair must be missing.
    """
    turns = np.degrees(angles_between(rotations[:, 1:], rotations[:, :-1]))[:, missing[1:] | missing[:-1]]
    return turns.max(axis=(1, 2)) if turns.size else np.full(len(turns), np.nan)


def largest_acceleration_mps2(positions: np.ndarray, missing: np.ndarray) -> np.ndarray:
    """(B,) the largest acceleration of a joint, second differences of positions (B, T, J, 3) over runs of three
    frames of which at least one is missing (T,); metres a second squared."""
    touched = np.convolve(missing, np.ones(3), mode="valid") > 0
    seconds = np.diff(np.asarray(positions, np.float64), n=2, axis=1)[:, touched]
    if not seconds.size:
        return np.full(len(positions), np.nan)
    return MODEL_FPS**2 * np.linalg.norm(seconds, axis=-1).max(axis=(1, 2))


def crossing_frames(shins: np.ndarray, missing: np.ndarray, radius_m: float) -> np.ndarray:
    """(B,) number of missing frames in which the axes of the two shins come nearer than a shin's radius.

    Args:
        shins: (B, T, 2, 2, 3) metres: left and right, knee and ankle.
    """
    left, right = np.moveaxis(np.asarray(shins, np.float64)[:, missing], 2, 0)
    distances = segment_distances(left[..., 0, :], left[..., 1, :], right[..., 0, :], right[..., 1, :])
    return (distances < radius_m).sum(axis=1).astype(np.float64)


def floating_mm(heights: np.ndarray, floors: np.ndarray, contacts: np.ndarray, missing: np.ndarray) -> np.ndarray:
    """(B,) height of the lowest contact joint above its floor, mean over the missing frames in which a true foot
    stands; millimetres, NaN where none does.

    Args:
        heights: (B, T, F) of the contact joints, metres. floors: (B, F) metres.
        contacts: (B, T, F) bool, the truth's.
    """
    stands = contacts.any(axis=-1) & missing
    above = np.maximum((heights - floors[:, None]).min(axis=-1), 0.0)
    count = stands.sum(axis=1)
    return np.where(count > 0, MILLIMETRES * (above * stands).sum(axis=1) / np.maximum(count, 1), np.nan)


def twists(turn_deg: np.ndarray, true_turn_deg: np.ndarray) -> np.ndarray:
    """(B,) 1.0 where a window twists, by its and the true window's `largest_turn_deg`, else 0.0."""
    return ((turn_deg > TWIST_DEG) & (turn_deg > TWIST_SHARE * true_turn_deg)).astype(np.float64)


def jolts(acceleration_mps2: np.ndarray, true_acceleration_mps2: np.ndarray) -> np.ndarray:
    """(B,) 1.0 where a window jolts, by its and the true window's `largest_acceleration_mps2`, else 0.0."""
    return (acceleration_mps2 > JOLT_SHARE * true_acceleration_mps2).astype(np.float64)


def segment_distances(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """(...) smallest distance between segments a-b and c-d, points (..., 3).

    The nearest points lie inside both segments, or one of them is an end: the least of five distances.
    """
    u, v, w = b - a, d - c, a - c
    uu, vv, uv = (u * u).sum(-1), (v * v).sum(-1), (u * v).sum(-1)
    uw, vw = (u * w).sum(-1), (v * w).sum(-1)
    area = uu * vv - uv * uv
    skew = area > 1e-12 * uu * vv
    s = np.where(skew, (uv * vw - vv * uw) / np.where(skew, area, 1.0), -1.0)
    t = np.where(skew, (uu * vw - uv * uw) / np.where(skew, area, 1.0), -1.0)
    inside = (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    between = np.linalg.norm(w + s[..., None] * u - t[..., None] * v, axis=-1)
    ends = [_point_distance(p, *segment) for p, segment in ((a, (c, d)), (b, (c, d)), (c, (a, b)), (d, (a, b)))]
    return np.minimum(np.where(inside, between, np.inf), np.minimum.reduce(ends))


def _point_distance(point: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(...) from a point to the segment a-b."""
    along = b - a
    share = ((point - a) * along).sum(-1) / np.maximum((along * along).sum(-1), 1e-12)
    return np.linalg.norm(point - a - np.clip(share, 0, 1)[..., None] * along, axis=-1)
