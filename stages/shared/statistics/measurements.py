"""From filled windows to named figures, under the two protocols (docs/evaluation.md)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from data_schemas.skeleton import BODY_GROUPS, NO_GROUP, Skeleton
from stages.shared.kinematics.rotations import aligned_signs, continuous_signs
from stages.shared.statistics import metrics

LEAST_BONE_M = 1e-6
LEAST_DEVIATION_M = 1e-3  # least deviation of an axis, so that a still axis does not dominate the norm


@dataclass(frozen=True)
class Metric:
    """How a metric is printed.

    headline: gets intervals in the summary.
    feel: a property of one motion, the truth's too, in a table of its own (`feel_tables`).
    beside_truth: its ratio is to the truth's figure, not to the plain baseline's.
    largest: a clip's value is the largest of its windows, and another row names that window (`first_frame_of`).
    """

    label: str
    unit: str
    headline: bool = False
    feel: bool = False
    beside_truth: bool = False
    largest: bool = False


METRICS: dict[str, Metric] = {
    "l2p_m": Metric("L2P", "m", headline=True),
    "l2q": Metric("L2Q", "", headline=True),
    "npss": Metric("NPSS", "", headline=True),
    "l2p_lafan1": Metric("L2P (LaFAN1)", "", headline=True),
    "l2q_lafan1": Metric("L2Q (LaFAN1)", "", headline=True),
    "npss_lafan1": Metric("NPSS (LaFAN1)", "", headline=True),
    "mpjpe_mm": Metric("MPJPE", "mm"),
    "mpjve_mm": Metric("MPJVE", "mm/frame"),
    "acceleration_mm": Metric("Acceleration error", "mm/frame²"),
    "mpjae_deg": Metric("MPJAE", "degrees"),
    "knn_cm": Metric("L_KNN", "cm", headline=True),
    "end_cm": Metric("L_end", "cm", headline=True),
    "key_jump_mps": Metric("Velocity jump at keys", "m/s", feel=True),
    "seam_share": Metric("Velocity change at window seams", "", feel=True),
    "foot_skate_mps": Metric("Foot skate", "m/s", feel=True),
    "floor_penetration_mm": Metric("Below the floor", "mm", feel=True),
    "jerk_mps3": Metric("Jerk", "m/s³", feel=True, beside_truth=True),
    "fell_back_share": Metric("Fell back", "", feel=True),
    "twist_share": Metric("Windows that twist", "", feel=True),
    "jolt_share": Metric("Windows that jolt", "", feel=True),
    "largest_turn_deg": Metric("Largest turn a frame", "degrees", feel=True, largest=True),
    "largest_acceleration_mps2": Metric("Largest acceleration", "m/s²", feel=True, largest=True),
    "crossing_frames": Metric("Shins crossed", "frames", feel=True, largest=True),
    "floating_mm": Metric("Feet above the floor", "mm", feel=True, largest=True),
}


def first_frame_of(metric: str) -> str:
    """The metric whose value is the first frame, at 30 frames a second, of a clip's window with the largest value."""
    return f"{metric}_first_frame"


METRICS |= {
    first_frame_of(name): Metric(f"{metric.label}, its window's first frame", "", feel=True)
    for name, metric in list(METRICS.items())
    if metric.largest
}


def metric_named(name: str) -> Metric:
    """How a metric is printed. A metric that `METRICS` does not list is printed under its own name, with
    intervals."""
    return METRICS.get(name) or Metric(name, "", headline=True)


POWER_WEIGHTED = ("npss", "npss_lafan1")
TRUTH = "truth"  # method name of rows with the truth's own figures
TRUE_CLOUD = "solve-true-cloud"  # the method that solves on the true cloud
REFINED = "-refined"  # follows the name of weights whose fills were refined by motion concepts
RECONSTRUCTED = "-reconstructed"  # follows the name of weights that solve on their reconstruction of the true cloud


@dataclass(frozen=True)
class Truth:
    """B true windows: global positions (B, T, J, 3), quaternions (B, T, J, 4); known (T,); index of the pelvis."""

    positions: np.ndarray
    rotations: np.ndarray
    known: np.ndarray
    root: int

    def centre(self) -> np.ndarray:
        """(B, 1, 1, 3) mean position of the pelvis over the known frames, subtracted from every window."""
        return self.positions[:, self.known, self.root].mean(axis=1)[:, None, None]


Measurements = dict[str, tuple[np.ndarray, np.ndarray]]
"""Metric to (B,) values and (B,) weights by which windows are averaged."""


def measured_joints(skeleton: Skeleton) -> np.ndarray:
    """Indices of the measured joints: those of the body whose bone has a length."""
    length = np.linalg.norm(skeleton.tails, axis=1)
    return np.flatnonzero((skeleton.groups != NO_GROUP) & (length > LEAST_BONE_M))


def measure(positions: np.ndarray, rotations: np.ndarray, truth: Truth, joints: np.ndarray) -> Measurements:
    """The project's own figures of B filled windows; shapes as `Truth`; `joints` are the measured joints."""
    p, p_true = positions[:, :, joints], truth.positions[:, :, joints]
    q, q_true = rotations[:, :, joints], truth.rotations[:, :, joints]
    q = aligned_signs(q, q_true)
    centre = truth.centre()
    spectrum = metrics.npss(metrics.pose_features(p - centre, q), metrics.pose_features(p_true - centre, q_true))
    ones = np.ones(len(positions))
    return {
        "l2p_m": (metrics.l2p_m(p, p_true), ones),
        "l2q": (metrics.l2q(q, q_true), ones),
        "npss": spectrum,
        "mpjpe_mm": (metrics.mpjpe_mm(p, p_true), ones),
        "mpjve_mm": (metrics.mpjve_mm(p, p_true), ones),
        "acceleration_mm": (metrics.acceleration_mm(p, p_true), ones),
        "mpjae_deg": (metrics.mpjae_deg(q, q_true), ones),
    }


def keys_beside_gaps(known: np.ndarray) -> np.ndarray:
    """Indices of known frames, not the first or last of the window, that have a missing neighbour."""
    inner = known[1:-1] & ~(known[:-2] & known[2:])
    return np.flatnonzero(inner) + 1


def measure_lafan1(
    positions: np.ndarray,
    rotations: np.ndarray,
    truth: Truth,
    joints: np.ndarray,
    across: np.ndarray,
    deviation: np.ndarray,
    *,
    by_root: bool = False,
) -> Measurements:
    """LaFAN1's own figures: only missing frames, positions in training deviations (J, 3), windows facing one
    direction.

    Args:
        across: (2,) joints at the left and the right hip, which give the heading (see `hip_joints`).
        by_root: take the heading from the pelvis' own Y axis, as the benchmark does on its rig.
    """
    last_before_gap = int(np.flatnonzero(~truth.known)[0]) - 1
    roots = truth.rotations[:, last_before_gap, truth.root] if by_root else None
    turn = facing_turn(truth.positions[:, last_before_gap], across, roots)
    missing = ~truth.known
    p, p_true = (turned_vectors(turn, x[:, missing][:, :, joints]) for x in (positions, truth.positions))
    q, q_true = (turned_quaternions(turn, x[:, missing][:, :, joints]) for x in (rotations, truth.rotations))
    # The benchmark's signs go on from the last known frame, which is the same in both, so they agree in the first.
    q = np.concatenate([aligned_signs(q[:, :1], q_true[:, :1]), q[:, 1:]], axis=1)
    q, q_true = continuous_signs(q, axis=1), continuous_signs(q_true, axis=1)
    ones = np.ones(len(positions))
    flat, flat_true = (x.reshape(*x.shape[:2], -1) for x in (q, q_true))
    return {
        "l2p_lafan1": (metrics.l2p_lafan1(p, p_true, deviation), ones),
        "l2q_lafan1": (metrics.l2q_lafan1(q, q_true), ones),
        "npss_lafan1": metrics.npss_lafan1(flat, flat_true),
    }


def position_deviation(
    windows: np.ndarray, joints: np.ndarray, across: np.ndarray, root: int, roots: np.ndarray | None = None
) -> np.ndarray:
    """(J, 3) standard deviation of each joint and axis over training windows, as LaFAN1's benchmark takes it.

    Args:
        windows: (N, T, all joints, 3) positions; each window is centred on the ground plane and turned to face one
            direction at its tenth frame.
        roots: (N, T, 4) rotations of the pelvis, where its Y axis gives the heading (see `facing_turn`).
    """
    ground = windows[:, :, root, :].mean(axis=1)[:, None, None] * [1, 0, 1]
    turn = facing_turn(windows[:, 9], across, None if roots is None else roots[:, 9])
    centred = turned_vectors(turn, windows[:, :, joints] - ground)
    return np.maximum(centred.std(axis=(0, 1)), LEAST_DEVIATION_M)


def hip_joints(skeleton: Skeleton) -> np.ndarray:
    """(2,) the topmost joints of the left and the right leg; the pelvis twice if there are no legs."""
    found = [np.flatnonzero(skeleton.groups == BODY_GROUPS.index(g)) for g in ("left_leg", "right_leg")]
    if not all(map(len, found)):
        return np.array([skeleton.root, skeleton.root])
    return np.array([joints[0] for joints in found])


def is_lafan1(skeleton: Skeleton) -> bool:
    """Whether a rig is LaFAN1's own: 22 joints, whose pelvis has its Y axis forward."""
    return skeleton.joints == 22 and {"Hips", "LeftUpLeg", "Spine2", "RightToe"} <= set(skeleton.names)


def facing_turn(positions: np.ndarray, across: np.ndarray, roots: np.ndarray | None = None) -> Rotation:
    """B turns about Y that make bodies (B, J, 3) face +Z, from the line between their hips; with `roots` (B, 4), the
    pelvis' rotations, from its Y axis."""
    if roots is not None:
        forward = Rotation.from_quat(roots).apply([0.0, 1.0, 0.0])
        return Rotation.from_rotvec(-np.arctan2(forward[:, 0], forward[:, 2])[:, None] * [0.0, 1.0, 0.0])
    left = positions[:, across[0]] - positions[:, across[1]]
    heading = np.arctan2(-left[:, 2], left[:, 0])  # zero where the left hip lies on +X of the right one
    return Rotation.from_rotvec(-heading[:, None] * [0.0, 1.0, 0.0])


def turned_vectors(turn: Rotation, vectors: np.ndarray) -> np.ndarray:
    """(B, ..., 3) vectors, each window by its own turn."""
    return np.einsum("bij,b...j->b...i", turn.as_matrix(), vectors)


def turned_quaternions(turn: Rotation, quaternions: np.ndarray) -> np.ndarray:
    """(B, T, J, 4) global rotations xyzw, each window turned by its own turn (a product from the left)."""
    x, y, z, w = np.moveaxis(quaternions, -1, 0)
    a = turn.as_quat()[:, None, None]
    ax, ay, az, aw = (a[..., i] for i in range(4))
    return np.stack(
        [
            aw * x + ax * w + ay * z - az * y,
            aw * y - ax * z + ay * w + az * x,
            aw * z + ax * y - ay * x + az * w,
            aw * w - ax * x - ay * y - az * z,
        ],
        axis=-1,
    )
