"""Put left and right back where they are exchanged, mend noisy and missing frames from the clean ones, and take off
the jitter that is left.

No model is needed: noise is found in the motion itself (`stages.shared.kinematics.noisy_frames`), noisy values count
for almost nothing in Whittaker's smoother, and clean ones stay as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stages.shared.kinematics.noisy_frames import errors_from_clean, noisy_frames, noisy_joints
from stages.shared.kinematics.rotations import continuous_signs
from stages.shared.kinematics.runs import runs_of
from stages.shared.kinematics.swapped_sides import exchanged, exchanged_frames
from stages.shared.solve.smoothing import smooth_as_needed, smooth_corrections

_MISSING_WEIGHT = 1e-6  # of a missing frame, against 1
_SPAN = 0.3  # frames; so short that the curve meets the clean frames
_MANY = 0.1  # with more noisy frames than this, the frames between them are too few to judge joints alone
_JITTER_RAD = np.radians(0.15)  # root mean square; a joint whose jitter is less stays as it is
_JITTER_M = 0.001
# Least median, as a share of the root mean square, where few frames are noisy; what mending leaves of many is uneven.
_STEADY = 0.8
_OF_MEDIAN = 1.126  # times the median is the root mean square, of the length of Gaussian noise in three directions
_FROZEN_FRAMES = 4
_FROZEN_JUMP = 4.0  # times the joint's usual step: how far it jumps when it is freed
_LOST_DEGREES = 10.0


@dataclass(frozen=True)
class Mended:
    """local (T, J, 4) unit float64, positions (T, C), noisy (T, J) True where a joint was mended, frames (T,) True
    where the whole frame was, swapped (T, J) True where a joint got the rotation of its partner on the other side."""

    local: np.ndarray
    positions: np.ndarray
    noisy: np.ndarray
    frames: np.ndarray
    swapped: np.ndarray


def mend_poses(
    local: np.ndarray,
    positions: np.ndarray,
    missing: np.ndarray | None = None,
    limbs: Sequence[np.ndarray] = (),
) -> Mended:
    """Put exchanged limbs back, find noisy frames and joints, mend them from clean frames, smooth jitter.

    Args:
        local: (T, J, 4) unit quaternions in the parents' frames. positions: (T, C) position channels, metres.
        missing: (T, J) True where a rotation is not there; positions of frames with no joint there are missing too.
        limbs: pairs (P, 2) of left and right joints, of each limb whose sides may be exchanged.

    In each column of `missing` one frame at least must be there.
    """
    frames, joints = local.shape[:2]
    gone = np.zeros((frames, joints), bool) if missing is None else missing.copy()
    empty = np.asarray(gone.all(axis=1))
    local, gone, swapped = _sides_put_back(local, gone, limbs)
    curves = continuous_signs(_bridged(np.asarray(local, np.float64), gone))
    places = _bridged(np.asarray(positions, np.float64)[:, None], empty[:, None])[:, 0]
    if frames < 5:
        return Mended(curves, places, gone, empty, swapped)
    lost, frozen = lost_joints(curves), frozen_joints(curves)
    # Of a joint that is frozen for long, a line knows as much as a curve, and it does not swing beyond its ends.
    curves = continuous_signs(_bridged(curves, frozen))
    noisy = np.zeros(frames, bool)
    there = np.flatnonzero(~empty)
    noisy[there] = noisy_frames(curves[there], places[there])
    bad = gone | lost | noisy[:, None]
    if noisy.mean() < _MANY:
        bad |= noisy_joints(curves, ~(noisy | empty))
    whole = noisy | empty
    made = curves.copy()
    weights = np.where(gone | lost, _MISSING_WEIGHT, noise_weight(curves, noisy, empty))
    for columns in _alike(bad):
        first = columns[0]
        made[:, columns] = _mended(made[:, columns].reshape(frames, -1), bad[:, first], weights[:, first]).reshape(
            frames, len(columns), 4
        )
    made = _unit(made)
    places = _mended(
        places, whole, np.where(empty, _MISSING_WEIGHT, noise_weight(places[:, None], noisy, empty)[:, 0])
    )
    steady = _STEADY if noisy.mean() < _MANY else 0.0
    return Mended(
        _without_jitter(made, steady), _positions_without_jitter(places, steady), bad | frozen, whole, swapped
    )


def _sides_put_back(
    local: np.ndarray, gone: np.ndarray, limbs: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotations, what is missing of them, and (T, J) True where they were exchanged with the other side's."""
    swapped = np.zeros(gone.shape, bool)
    there = np.flatnonzero(~gone.all(axis=1))
    if not limbs or len(there) < 5:
        return local, gone, swapped
    curves = _bridged(np.asarray(local, np.float64), gone)[there]
    for limb in limbs:
        at = there[exchanged_frames(curves, limb)]
        if len(at):
            local, gone = exchanged(local, at, limb), exchanged(gone, at, limb)
            swapped[at[:, None], limb.ravel()] = True
    return local, gone, swapped


def lost_joints(rotations: np.ndarray) -> np.ndarray:
    """(T, J) True where a joint's rotation is exactly the identity, its usual rotation is another, and it jumps there
    and back: zeros that a tracker wrote for a joint that it lost. A pose that is reached smoothly, or held to the end
    of the clip, is none."""
    zero = np.abs(rotations[..., :3]).max(-1) < 1e-6
    usual = np.degrees(2 * np.arccos(np.clip(np.abs(rotations[..., 3]), 0, 1)))
    step = np.linalg.norm(np.diff(rotations, axis=0), axis=-1)
    found = np.zeros(zero.shape, bool)
    for joint in np.flatnonzero(zero.any(0) & (zero.mean(0) < 0.5)):
        there = ~zero[:, joint]
        if np.median(usual[there, joint]) <= _LOST_DEGREES:
            continue
        jump = _FROZEN_JUMP * np.median(step[there[1:] & there[:-1], joint])
        for run in runs_of(zero[:, joint]):
            start, stop = int(run[0]), int(run[-1]) + 1
            inside = start > 0 and stop < len(zero)
            found[run, joint] = inside and min(step[start - 1, joint], step[stop - 1, joint]) > jump
    return found


def frozen_joints(rotations: np.ndarray) -> np.ndarray:
    """(T, J) True in frames where a joint holds exactly the rotation of the frame before, for 4 frames or more, and
    jumps when it is freed. A pose that is held and left smoothly is none."""
    step = np.linalg.norm(np.diff(rotations, axis=0), axis=-1)
    found = np.zeros(rotations.shape[:2], bool)
    for joint in range(rotations.shape[1]):
        moves = step[:, joint] > 1e-7
        if moves.mean() < 0.5:  # a joint that mostly stands still is held on purpose
            continue
        usual = np.median(step[moves, joint])
        for run in runs_of(~moves):
            start, stop = int(run[0]), int(run[-1]) + 1
            freed = step[stop, joint] if stop < len(step) else 0.0
            if stop - start >= _FROZEN_FRAMES and freed > _FROZEN_JUMP * usual:
                found[start + 1 : stop + 1, joint] = True
    return found


def _bridged(values: np.ndarray, missing: np.ndarray) -> np.ndarray:
    """Values (T, J, C) with missing ones (T, J) on lines between those that are there."""
    out = np.where(missing[..., None], 0.0, values)
    frames = np.arange(len(values))
    for column in np.flatnonzero(missing.any(axis=0)):
        at = np.flatnonzero(~missing[:, column])
        if len(at) == 0:
            out[:, column] = [0.0, 0.0, 0.0, 1.0][: values.shape[2]]
            continue
        there = values[at, column]
        there = continuous_signs(there) if values.shape[2] == 4 else there
        for part in range(values.shape[2]):
            out[:, column, part] = np.interp(frames, at, there[:, part])
    return _unit(out) if values.shape[2] == 4 else out


def _alike(bad: np.ndarray) -> list[np.ndarray]:
    """Joints with the same bad frames, which are mended together; those without any are left out."""
    by_pattern: dict[bytes, list[int]] = {}
    for joint in np.flatnonzero(bad.any(axis=0)):
        by_pattern.setdefault(bad[:, joint].tobytes(), []).append(int(joint))
    return [np.array(joints) for joints in by_pattern.values()]


def noise_weight(values: np.ndarray, noisy: np.ndarray, empty: np.ndarray) -> np.ndarray:
    """The weight of a noisy frame in the smoother, (1, J), against 1 for a clean one.

    The smoother's curve is the most probable one if weights are the ratio of the acceleration's variance to the
    noise's, times span^4. A line through the frames beside a frame misses it by half its acceleration; a noisy one,
    by its noise.

    Args:
        values: (T, J, C). noisy, empty: (T,) noisy frames, and those without values.
    """
    joints = values.shape[1]
    clean = ~(noisy | empty)
    least = np.full((1, joints), _MISSING_WEIGHT)
    if not noisy.any() or clean.sum() < 3 or values.shape[2] == 0:
        return least
    weights = least.copy()
    for joint in range(joints):
        error, gap = errors_from_clean(values[:, joint : joint + 1], clean)
        bend, noise = 2 * np.median(error[clean] / gap[clean]), np.median(error[noisy])
        weights[0, joint] = _SPAN**4 * bend**2 / max(noise**2, 1e-12)
    return np.clip(weights, _MISSING_WEIGHT, 1.0)


def _mended(curves: np.ndarray, bad: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Curves (T, F) whose bad frames (T,) follow from the others and, by their weights (T,), from themselves."""
    if not bad.any() or bad.all():
        return curves
    times = np.arange(len(curves), dtype=float)
    weights = np.where(bad, weights, 1.0)
    smooth = smooth_corrections(curves, np.zeros_like(curves), times, np.zeros(len(curves), bool), _SPAN, weights)
    return np.where(bad[:, None], smooth, curves)


def _without_jitter(rotations: np.ndarray, steady: float) -> np.ndarray:
    smooth = _unit(smooth_as_needed(rotations.reshape(len(rotations), -1), together=4).reshape(rotations.shape))
    turned = 2 * np.linalg.norm(smooth - rotations, axis=-1)  # radians, of small turns
    return np.where(_jitters(turned, _JITTER_RAD, steady)[None, :, None], smooth, rotations)


def _positions_without_jitter(positions: np.ndarray, steady: float) -> np.ndarray:
    if positions.shape[1] == 0:
        return positions
    smooth = smooth_as_needed(positions, together=3)
    moved = np.linalg.norm((smooth - positions).reshape(len(positions), -1, 3), axis=-1)
    return np.where(np.repeat(_jitters(moved, _JITTER_M, steady), 3)[None], smooth, positions)


def _jitters(taken: np.ndarray, least: float, steady: float) -> np.ndarray:
    """(J,) True where what a smoother takes off, (T, J), is large enough and there in all frames. What it takes off a
    quick movement is large in a few frames, so that the median lies far below the root mean square."""
    size = np.sqrt((taken**2).mean(axis=0))
    return (size > least) & (_OF_MEDIAN * np.median(taken, axis=0) >= steady * size)


def _unit(rotations: np.ndarray) -> np.ndarray:
    return rotations / np.maximum(np.linalg.norm(rotations, axis=-1, keepdims=True), 1e-9)
