"""The figures of a followed cloud: errors on the bones that carry points, and properties compared with the
truth's."""

from __future__ import annotations

import numpy as np

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.kinematics.foot_contacts import detect_contacts, find_feet, foot_skate_mps
from stages.shared.kinematics.forward import positions_of
from stages.shared.statistics import metrics

LABELS = {
    "mpjpe_mm": "MPJPE (mm)",
    "l2p_m": "L2P (m)",
    "l2q": "L2Q",
    "mpjae_deg": "MPJAE (degrees)",
    "jerk_ratio": "jerk / truth's",
    "skate_mps": "foot skate (m/s)",
}


def measurements_of(skeleton: Skeleton, truth: Motion, made: Motion) -> dict[str, float]:
    """All figures of one clip; those that cannot be measured on the clip are left out."""
    joints = np.flatnonzero(skeleton.sampled)
    places, true_places = positions_of(skeleton, made), positions_of(skeleton, truth)
    p, p_true = places[:, joints], true_places[:, joints]
    q, q_true = made.rotations[:, joints], truth.rotations[:, joints]
    found = {
        "mpjpe_mm": metrics.mpjpe_mm(p, p_true),
        "l2p_m": metrics.l2p_m(p, p_true),
        "l2q": metrics.l2q(q, q_true),
        "mpjae_deg": metrics.mpjae_deg(q, q_true),
        "jerk_ratio": jerk(p) / max(jerk(p_true), 1e-9),
        "skate_mps": skate_mps(skeleton, true_places, places, truth.fps),
    }
    return {name: float(value) for name, value in found.items() if np.isfinite(value)}


def jerk(positions: np.ndarray) -> float:
    """Mean norm of the third differences of positions (T, J, 3), metres a frame cubed."""
    return float(np.linalg.norm(np.diff(positions.astype(np.float64), n=3, axis=0), axis=-1).mean())


def skate_mps(skeleton: Skeleton, truth: np.ndarray, made: np.ndarray, fps: float) -> float:
    """Foot skate of positions (T, J, 3) while the true feet stand, metres a second; NaN if they never stand."""
    feet = find_feet(skeleton)
    return foot_skate_mps(made, detect_contacts(truth, feet, fps), feet, fps)
