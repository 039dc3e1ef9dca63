"""Which frames of a motion are noisy, from the motion alone.

A frame that was not disturbed lies near the line through two undisturbed frames in its neighbourhood. A noisy one
lies near no such line, since noise is independent from frame to frame. So every frame is predicted from all pairs of
frames near it; its smallest error separates the two kinds even if most frames are noisy. What this finds is then
refined: each frame is predicted from the nearest frames that were found clean. Errors are of quaternions, the median
over joints where a whole frame is judged, so that a few fast joints do not make a frame noisy; errors of positions
count beside them, with less weight. Several first guesses are refined, since one that takes noisy frames for clean
may grow worse, and the result with the widest margin between noisy and clean frames is taken.

Lines also miss a short, quick movement, such as a kick. But a movement is smooth from frame to frame, and noise is
not: of independent noise, fourth differences are sqrt(70 / 6) = 3.4 times as large as second differences, of a
movement that swings once in four frames twice as large, of slower ones less. What is found is noise only if it is
that rough, and if it does not go on in one direction much faster than the frames around.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from math import comb

import numpy as np
from scipy.ndimage import percentile_filter

from stages.shared.kinematics.runs import runs_of

REACH = 8  # frames to both sides that predict a frame
FLOOR = 0.004  # an error of quaternions below this, about half a degree, is no noise
JOINT_FLOOR = 0.02  # the same for one joint alone, whose error varies more
PLACE_FLOOR = 0.002  # the same for positions, metres
_PLACE_WEIGHT = 0.4
_GUESS_LIMIT = 1.5  # times the level around a frame
_GUESS_SHARES = (0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9)  # of the frames, taken for clean
_LEAST_CONTRAST = 0.4  # of logarithms; a channel whose noisy frames stand out less says nothing
_BETWEEN = 0.6  # way from the clean frames' level to the noisy ones' at which a frame is noisy
_UNSETTLED = 8.0  # what the share of frames that a further round changes takes off the margin
_MOST_SAID = 2.0  # by one channel about one frame
_LEAST_MARGIN = 0.8  # jitter of all frames seldom reaches it
_MOTION_PERCENT, _NOISY_PERCENT, _CLEAN_PERCENT = 60, 20, 90
_QUICK = 2.0  # times the usual step, of a quick movement
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
_ROUGH_FRAMES, _ROUGH_JOINTS = 0.73, 0.82  # least roughness, as a share of that of noise alone
_ROUGH_TOGETHER = 0.65  # the same of all runs as one, where many frames are noisy
_ROUGHER = 4.0  # times the energy of fourth differences of clean frames, of a noisy run at an end of the clip
_LEAST_AT_ENDS = 3  # frames of a run at an end of the clip; fewer cannot be judged
_FEW = 0.16  # share of the frames; quick movements are no more, so where more are noisy, all are taken for noise
_NEAR = 3  # frames, within which a line may be continued beyond two clean frames


@dataclass(frozen=True)
class _Channel:
    """values: (T, J, C), of which each frame has one error, the median over J. floor: an error below it is no noise.
    weight: of its evidence; the error of a single position varies more than a median over many joints."""

    values: np.ndarray
    floor: float
    weight: float


def noisy_frames(rotations: np.ndarray, positions: np.ndarray | None = None) -> np.ndarray:
    """Frames in which most joints or the positions are noisy.

    Several first guesses are refined; that is taken whose noisy frames stand out most from its clean ones.

    Args:
        rotations: (T, J, 4) local unit quaternions with continuous signs. positions: (T, C) channels, metres, C a
            multiple of 3.

    Returns: (T,) bool; all False for fewer than 5 frames, or if nothing moves.
    """
    frames = len(rotations)
    places = np.zeros((frames, 0)) if positions is None else positions
    channels = [
        _Channel(moving, floor, weight)
        for values, floor, weight in (
            (rotations, FLOOR / 2, 1.0),
            (places.reshape(frames, -1, 3), PLACE_FLOOR / 2, _PLACE_WEIGHT),
        )
        if (moving := values[:, np.ptp(values, axis=0).max(-1, initial=0.0) > 1e-6]).shape[1]
    ]
    best = np.zeros(frames, bool)
    if frames < 5 or not channels:
        return best
    most, seen = _LEAST_MARGIN, set[bytes]()
    for guess in _guesses(channels):
        found, margin = _split(channels, guess, seen)
        if margin > most and (found := _judged(channels, found)).any():
            best, most = found, margin
    return best


def _judged(channels: Sequence[_Channel], noisy: np.ndarray) -> np.ndarray:
    """(T,) the noisy frames without those that are a movement."""
    noisy = noisy & ~_quick(channels[0].values.reshape(len(noisy), -1), noisy) & ~_smooth_ends(channels, noisy)
    if noisy.mean() >= _FEW:
        return np.any([_rough(each.values, noisy, _ROUGH_TOGETHER, together=True) for each in channels], axis=0)
    return np.any(
        [_rough(each.values, noisy & _beyond_motion(each.values, noisy), _ROUGH_FRAMES) for each in channels], axis=0
    )


def _smooth_ends(channels: Sequence[_Channel], noisy: np.ndarray) -> np.ndarray:
    """(T,) True where a run of noisy frames at an end of the clip is no rougher than clean frames, from its outer end
    inwards. Lines that are continued from clean frames far away miss these frames whether they are noisy or not, and
    nothing beyond them tells what the motion was."""
    smooth = np.zeros(len(noisy), bool)
    runs = [run for run in runs_of(noisy) if len(run) > REACH and (run[0] == 0 or run[-1] == len(noisy) - 1)]
    still = np.convolve(noisy, np.ones(5), mode="valid") == 0  # frames 2 to T - 3 with two clean ones on both sides
    if not runs or not still.any():
        return smooth
    rough = [(np.diff(each.values, n=4, axis=0) ** 2).sum((1, 2)) for each in channels]
    for run in runs:
        inwards = run if run[0] == 0 else run[::-1]
        for first in range(0, len(inwards), REACH):
            piece = inwards[first : first + REACH]
            at = np.unique(np.clip(piece - 2, 0, len(still) - 1))
            if any(np.median(each[at]) > _ROUGHER * np.median(each[still]) for each in rough):
                break
            smooth[piece] = True
    return smooth


def _guesses(channels: Sequence[_Channel]) -> Iterator[np.ndarray]:
    """First guesses (T,) of the noisy frames: those far above the level around them, and fixed shares of all."""
    for channel in channels:
        score = np.sqrt(pair_errors(channel.values, together=True))
        yield _first_guess(score, _GUESS_LIMIT, 2 * channel.floor)
        for share in _GUESS_SHARES:
            yield score > max(np.quantile(score, share), channel.floor)


def _split(channels: Sequence[_Channel], noisy: np.ndarray, seen: set[bytes]) -> tuple[np.ndarray, float]:
    """Refine a guess of the noisy frames until it stays.

    Logarithms of errors from the clean frames are compared with the level of the clean frames nearby and with the
    noisy frames' median; a frame is noisy if it lies nearer to the noisy ones.

    Args:
        seen: guesses that were refined before, which end here. They are added to.

    Returns: (T,) the noisy frames, and their margin: how far the noisy frames' errors lie above the clean ones', in
        logarithms; minus infinity where there is no result.
    """
    frames = np.arange(len(noisy))
    best = (np.zeros(len(noisy), bool), -np.inf)
    for _ in range(_ROUNDS):
        key = noisy.tobytes()
        at = np.flatnonzero(~noisy)
        if key in seen or len(at) == len(noisy) or len(at) < 3:
            break
        excess, score = np.zeros(len(noisy)), np.zeros(len(noisy))
        for channel in channels:
            error, gap = errors_from_clean(channel.values, ~noisy)
            spread = np.log(np.maximum(gap, 1.0)) / 2  # errors of motion grow with the time between clean frames
            level = np.log(np.maximum(error, channel.floor))
            still = np.maximum(level - spread, np.log(channel.floor))[at]
            motion, noise = np.median(still), np.median(level[noisy])
            if noise - motion < _LEAST_CONTRAST:
                continue
            around = percentile_filter(still, _MOTION_PERCENT, size=min(_AROUND, 2 * len(at) - 1), mode="nearest")
            clean = np.interp(frames, at, np.maximum(around, motion)) + spread
            both = np.logaddexp(2 * noise, 2 * clean) / 2
            excess += channel.weight * (level - motion - spread)
            score += channel.weight * np.clip(level - clean - _BETWEEN * (both - clean), -_MOST_SAID, _MOST_SAID)
        seen.add(key)
        again = score > 0
        margin = np.percentile(excess[noisy], _NOISY_PERCENT) - np.percentile(excess[at], _CLEAN_PERCENT)
        margin -= _UNSETTLED * (again != noisy).mean()
        if margin > best[1]:
            best = noisy, float(margin)
        noisy = again
    return best


def _quick(values: np.ndarray, noisy: np.ndarray) -> np.ndarray:
    """(T,) True in runs of noisy frames of values (T, F) that are a quick movement: its steps go on in one direction
    and are larger than those between clean frames, while noise comes back at once."""
    quick = np.zeros(len(noisy), bool)
    steps = np.diff(values, axis=0)
    size = np.linalg.norm(steps, axis=1)
    clean = ~(noisy[1:] | noisy[:-1])
    for run in runs_of(noisy):
        start, stop = max(0, int(run[0]) - 1), min(len(steps), int(run[-1]) + 1)
        near = slice(max(0, start - _AROUND), stop + _AROUND)
        if stop - start < 2 or not clean[near].any():
            continue
        goes_on = (steps[start : stop - 1] * steps[start + 1 : stop]).sum() > 0
        quick[run] = goes_on and np.sqrt((size[start:stop] ** 2).mean()) > _QUICK * np.median(size[near][clean[near]])
    return quick


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


def _rough(values: np.ndarray, noisy: np.ndarray, least: float, *, together: bool = False) -> np.ndarray:
    """(T,) the noisy frames of values (T, J, C), without runs in which the values are smooth.

    least: ratio of fourth to second differences of a rough run, as a share of what independent noise in its frames
        alone would give; near an end of the clip that is less than elsewhere. together: judge all runs as one.
    """
    if not noisy.any() or len(values) < 5:
        return noisy
    energies = []
    for order in (2, 4):
        found, expected = np.zeros(len(values)), np.zeros(len(values))
        inner = slice(order // 2, len(values) - order // 2)
        found[inner] = (np.diff(values, n=order, axis=0) ** 2).sum((1, 2))
        factors = np.array([comb(order, each) for each in range(order + 1)], float) ** 2
        expected[inner] = np.convolve(noisy, factors, mode="valid")
        energies.append(np.stack([found, expected]))
    runs = [np.arange(max(0, run[0] - 2), min(len(values), run[-1] + 3)) for run in runs_of(noisy)]
    if together:
        runs = [np.unique(np.concatenate(runs))]
    kept = noisy.copy()
    for wide in runs:
        (second, second_of_noise), (fourth, fourth_of_noise) = (each[:, wide].sum(1) for each in energies)
        at_end = (wide[0] == 0 and noisy[0]) or (wide[-1] == len(values) - 1 and noisy[-1])
        few = at_end and noisy[wide].sum() < _LEAST_AT_ENDS
        if few or fourth * second_of_noise < least**2 * second * fourth_of_noise:
            kept[wide] = False
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
