"""Which frames of a motion are noisy, from the motion alone.

A frame that was not disturbed lies near the line through two undisturbed frames in its neighbourhood. A noisy one
lies near no such line, since noise is independent from frame to frame. So every frame is predicted from all pairs of
frames near it; its smallest error separates the two kinds even if most frames are noisy. What this finds is then
refined: each frame is predicted from the nearest frames that were found clean. Errors are of quaternions, the median
over joints where a whole frame is judged, so that a few fast joints do not make a frame noisy.

Lines also miss a short, quick movement, such as a kick. But a movement is smooth from frame to frame, and noise is
not: of independent noise, fourth differences are sqrt(70 / 6) = 3.4 times as large as second differences, of a
movement that swings once in four frames twice as large, of slower ones less. What is found is noise only if it is
that rough.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.ndimage import percentile_filter

from stages.shared.kinematics.runs import runs_of

REACH = 8  # frames to both sides that predict a frame
FLOOR = 0.004  # an error of quaternions below this, about half a degree, is no noise
JOINT_FLOOR = 0.02  # the same for one joint alone, whose error varies more
_MOST_GAIN = 6.0  # pairs of frames that amplify noise by more than this predict nothing
_LOCAL = 61  # frames, over which the level of clean motion is taken
_FRAME_LIMITS = (1.5, 4.0)  # times that level: before the refinement, where too many do no harm, and in it
_JOINT_LIMITS = (5.0, 6.0)
# Quantile of the clean frames' errors that is taken for motion; frames wrongly taken for clean lie above it.
_MOTION = 0.2
_OF_NOISE = 0.35  # share of the noisy frames' median error; a frame below it is not noisy
_ROUNDS = 8
_AT_ENDS, _MOST_GROWTH = 2.0, 3.0  # factor on the limit at the ends; largest factor for a long gap
_BEYOND, _HIGH, _AROUND = 3.0, 80, 25  # limit: so many times this percentile of the errors of so many clean frames
_ROUGH_FRAMES, _ROUGH_JOINTS = 2.5, 2.8  # least ratio of fourth to second differences
_FEW = 0.1  # share of the frames; quick movements are no more, so that with more noisy frames all are taken for noise
_NEAR = 3  # frames, within which a line may be continued beyond two clean frames


def noisy_frames(rotations: np.ndarray) -> np.ndarray:
    """Frames in which most joints are noisy.

    Args:
        rotations: (T, J, 4) local unit quaternions with continuous signs.

    Returns: (T,) bool; all False for fewer than 5 frames, or if nothing moves.
    """
    values = rotations[:, np.ptp(rotations, axis=0).max(-1) > 1e-6]
    if len(values) < 5 or values.shape[1] == 0:
        return np.zeros(len(rotations), bool)
    score = np.sqrt(pair_errors(values, together=True))
    found = _refined(values, _first_guess(score, _FRAME_LIMITS[0], FLOOR), _FRAME_LIMITS[1], FLOOR)
    return _rough(values, found, _ROUGH_FRAMES) if found.mean() < _FEW else found


def noisy_joints(rotations: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """Joints that are noisy in a frame, each judged alone; frames that are not usable are left out.

    Args:
        rotations: (T, J, 4) as above. usable: (T,) bool.

    Returns: (T, J) bool, False where not usable.
    """
    found = np.zeros(rotations.shape[:2], bool)
    at = np.flatnonzero(usable)
    if len(at) < 5:
        return found
    values = rotations[at]
    score = np.sqrt(pair_errors(values, together=False))
    for joint in np.flatnonzero(np.ptp(values, axis=0).max(-1) > 1e-6):
        guess = _first_guess(score[:, joint], _JOINT_LIMITS[0], JOINT_FLOOR)
        own = values[:, joint : joint + 1]
        found[at, joint] = _rough(own, _refined(own, guess, _JOINT_LIMITS[1], JOINT_FLOOR), _ROUGH_JOINTS)
    return found


def _first_guess(score: np.ndarray, limit: float, floor: float) -> np.ndarray:
    """(T,) True where a score is far above the low scores around it."""
    level = percentile_filter(score, 10, size=min(_LOCAL, 2 * len(score) - 1), mode="nearest")
    return (score > limit * level) & (score > floor)


def _refined(values: np.ndarray, noisy: np.ndarray, limit: float, floor: float) -> np.ndarray:
    """(T,) the noisy frames of values (T, J, C), judged by lines through the clean ones, again and again."""
    for _ in range(_ROUNDS):
        if not noisy.any() or (~noisy).sum() < 3:
            break
        error, gap = errors_from_clean(values, ~noisy)
        # The error of a line through clean frames grows with the time between them.
        motion = np.quantile(error[~noisy] / np.sqrt(gap[~noisy]), _MOTION)
        again = error > np.maximum(limit * motion * np.sqrt(gap), floor)
        again &= error > _OF_NOISE * np.median(error[noisy])
        if (again == noisy).all():
            break
        noisy = again
    return noisy & _beyond_motion(values, noisy)


def _beyond_motion(values: np.ndarray, noisy: np.ndarray) -> np.ndarray:
    """(T,) True where a noisy frame's error is also far above that of the clean frames near it: in a fast movement
    lines through clean frames miss every frame. At the ends, where a line must be continued, more is asked for."""
    clean = ~noisy
    if not noisy.any() or clean.sum() < 3:
        return noisy
    error, gap = errors_from_clean(values, clean)
    level = error / np.sqrt(gap)
    at = np.flatnonzero(clean)
    usual = percentile_filter(level[at], _HIGH, size=min(_AROUND, 2 * len(at) - 1), mode="nearest")
    frames = np.arange(len(values))
    near = np.interp(frames, at, usual)
    asked = np.where((frames < at[0]) | (frames > at[-1]), _AT_ENDS * _BEYOND, _BEYOND)
    return error > asked * near * np.minimum(np.sqrt(gap), _MOST_GROWTH)


def _rough(values: np.ndarray, noisy: np.ndarray, limit: float) -> np.ndarray:
    """(T,) the noisy frames of values (T, J, C), without runs in which the values are smooth; runs at the ends of the
    clip cannot be judged and stay."""
    if not noisy.any() or len(values) < 5:
        return noisy
    second, fourth = np.zeros(len(values)), np.zeros(len(values))
    second[1:-1] = (np.diff(values, n=2, axis=0) ** 2).sum((1, 2))
    fourth[2:-2] = (np.diff(values, n=4, axis=0) ** 2).sum((1, 2))
    kept = noisy.copy()
    for run in runs_of(noisy):
        start, stop = int(run[0]), int(run[-1]) + 1
        if start >= 2 and stop <= len(values) - 2:
            smooth = fourth[start - 2 : stop + 2].sum() < limit**2 * second[start - 1 : stop + 1].sum()
            kept[start:stop] = not smooth
    return kept


def pair_errors(values: np.ndarray, *, together: bool, reach: int = REACH) -> np.ndarray:
    """Each frame's smallest squared error of prediction by a line through two frames at most `reach` away.

    The error is divided by what independent noise in all three frames would multiply it by.

    Args:
        values: (T, J, C). together: take the median over joints before the smallest of all lines.

    Returns: (T,) if together, otherwise (T, J).
    """
    frames = len(values)
    best = np.full(values.shape[:1] if together else values.shape[:2], np.inf)
    for first, second, share in _pairs(min(reach, frames - 1)):
        start, stop = max(0, -first, -second), frames - max(0, first, second)
        if stop <= start:
            continue
        line = share * values[start + first : stop + first] + (1 - share) * values[start + second : stop + second]
        line -= values[start:stop]
        square = np.einsum("tjc,tjc->tj", line, line)
        square = (np.median(square, axis=1) if together else square) / _gain(share)
        np.minimum(best[start:stop], square, out=best[start:stop])
    return np.where(np.isfinite(best), best, 0.0)


def errors_from_clean(values: np.ndarray, clean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors of prediction by lines through the nearest clean frames, the frame itself left out.

    The line goes through the nearest before and after. Lines through the two before or the two after are tried too
    where both are near: a velocity that changes at once, such as at a step, is no noise.

    Args:
        values: (T, J, C). clean: (T,) bool, at least 3 True.

    Returns: (T,) roots of the median over joints of the squared errors, and (T,) the product of the distances to the
    two frames, frames^2.
    """
    frames = np.arange(len(values))
    before, after = _neighbours(clean)
    error, spread = np.full(len(values), np.inf), np.ones(len(values))
    lines = ((before[0], after[0], False), (before[0], before[1], True), (after[0], after[1], True))
    for first, second, outside in lines:
        there = (first >= 0) & (second >= 0)
        if outside:
            there &= (np.abs(second - frames) <= _NEAR) | ~np.isfinite(error)
        t, a, b = frames[there], first[there], second[there]
        share = ((b - t) / (b - a))[:, None, None]
        line = share * values[a] + (1 - share) * values[b]
        found = np.sqrt(np.median(((values[t] - line) ** 2).sum(-1), axis=1))
        gap = np.abs((t - a) * (b - t)).astype(float)
        better = found < error[t]
        error[t[better]], spread[t[better]] = found[better], gap[better]
    return np.where(np.isfinite(error), error, 0.0), spread


def _gain(share: float) -> float:
    return 1 + share * share + (1 - share) * (1 - share)


@cache
def _pairs(reach: int) -> tuple[tuple[int, int, float], ...]:
    """Offsets of two frames and the first one's share in the line through them at offset 0."""
    steps = [step for step in range(-reach, reach + 1) if step]
    pairs = [(a, b, b / (b - a)) for number, a in enumerate(steps) for b in steps[number + 1 :]]
    return tuple((a, b, share) for a, b, share in pairs if _gain(share) - 1 <= _MOST_GAIN)


def _neighbours(clean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(2, T) the nearest and second nearest clean frame before each frame, and after it; -1 where there is none."""
    return _two_before(clean), np.where(
        (reverse := _two_before(clean[::-1])[:, ::-1]) >= 0, len(clean) - 1 - reverse, -1
    )


def _two_before(clean: np.ndarray) -> np.ndarray:
    places = np.flatnonzero(clean)
    count = np.searchsorted(places, np.arange(len(clean)), side="left")  # clean frames before each
    padded = np.concatenate([[-1, -1], places])
    return np.stack([padded[count + 1], padded[count]])
