"""One motion in segments: its anchors, and the splines between them, in the paper's unit."""

from __future__ import annotations

import numpy as np

from data_schemas.concepts import NO_CLUSTER, SegmentedClip
from stages.shared.concepts.body_positions import fit_features
from stages.shared.kinematics.spline_segments import CUBIC, best_segments, fitted_splines, spline_frames

_CM = 100.0


def segmented(
    positions: np.ndarray,
    scale: float,
    fps: float,
    price: float,
    longest_s: float,
    action: str = "",
    degree: int = CUBIC,
) -> SegmentedClip:
    """Anchors and splines of a motion.

    Args:
        positions: (T, J, 3) metres on the rig; the pelvis is joint 0. scale: to the standard stature.
        fps: frames a second. price: the paper's lambda. longest_s: of a transition, in seconds.
        degree: of the polynomials that choose the anchors; the splines are cubics always.

    Returns: the clip with its positions scaled; no anchor has a cluster yet.
    """
    longest = max(1, int(longest_s * fps))
    anchors = best_segments(fit_features(positions, scale, fps), price, longest, degree).junctions
    places = np.asarray(positions, np.float64) * scale
    return SegmentedClip(
        positions=places.astype(np.float32),
        anchors=anchors.astype(np.int32),
        splines=fitted_splines(places, anchors).astype(np.float32),
        clusters=np.full(len(anchors), NO_CLUSTER, np.int32),
        action=action,
        scale=scale,
    )


def fit_error_cm(clip: SegmentedClip) -> float:
    """Mean distance of the joints from the splines, in centimetres on the standard body (the MPJPE of Table 2)."""
    if len(clip.anchors) < 2:
        return 0.0
    apart = spline_frames(clip.splines.astype(np.float64), clip.anchors) - clip.positions
    return float(_CM * np.linalg.norm(apart, axis=-1).mean())
