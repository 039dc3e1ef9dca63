"""The Euler curve of one joint between two keys, through the forms of its angles, by a shortest path.

A rotation has two Euler triples, and each angle may be written plus any whole turns: these are its forms. A curve
that takes in every frame the form nearest to the frame before may arrive in another form than the next key is written
in. So all curves without a jump are compared, from the form of one key to that of the other.
"""

from __future__ import annotations

import numpy as np

from stages.shared.formats.euler import LOCKED, nearest_locked, other_triple, parity_of

JUMP_DEGREES = 180.0  # a step of a channel beyond this is a jump, however the rotation moves
LOCK_STEP_DEGREES = 30.0  # of the middle angle, where the curve passes by gimbal lock and takes the other triple
_TURNS = 3  # whole turns by which a channel may be written apart from its curve in one triple


def path_between(angles: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray | None:
    """The curve of the least sum of squared steps, among those of which no channel jumps and which take the other
    triple beside gimbal lock alone: elsewhere the two triples lie half a turn apart.

    Args:
        angles: (M, n) degrees of the frames between two keys, in any form, n of 2 or 3.
        first, last: (n,) degrees of the keys, in the forms that the curve leaves and reaches.
    Returns: (M, n) degrees of the same rotations; None where every curve jumps, or a frame stands at gimbal lock.
    """
    if (np.abs(np.cos(np.deg2rad(angles[:, 1]))) < LOCKED).any():
        return None
    if angles.shape[1] == 2:  # the other triple turns about three axes: two channels have one form up to whole turns
        curve = np.unwrap(angles + 360.0 * np.round((first - angles[:1]) / 360.0), axis=0, period=360.0)
        return curve if largest_step(curve, first, last) <= JUMP_DEGREES else None
    triples = _two_triples(angles, first)
    centre = (_TURNS,) * angles.shape[1]
    turns = np.stack(np.meshgrid(*[np.arange(-_TURNS, _TURNS + 1)] * angles.shape[1], indexing="ij"), -1)
    costs = np.full((2, *turns.shape[:-1]), np.inf)
    for triple in range(2):
        crosses = triple != _triple_of(first)
        costs[(triple, *centre)] = _step_cost(triples[triple, 0] - first, crosses=crosses)
    came_from = np.zeros((len(angles), *costs.shape), bool)  # True: from the other triple
    shifts = np.zeros((len(angles), 2, angles.shape[1]), np.int64)
    for frame in range(1, len(angles)):
        now, before = triples[:, frame], triples[:, frame - 1]
        # Whole turns that bring a triple near the other one of the frame before.
        shifts[frame] = np.round((before[::-1] - now) / 360.0)
        crossed = now + 360.0 * shifts[frame] - before[::-1]
        new = np.empty_like(costs)
        for triple in range(2):
            stay = costs[triple] + _step_cost(now[triple] - before[triple])
            crossing = _step_cost(crossed[triple], crosses=True)
            cross = _shifted(costs[1 - triple], shifts[frame, triple]) + crossing
            came_from[frame, triple] = cross < stay
            new[triple] = np.minimum(stay, cross)
        costs = new
    arrival = last - (triples[:, -1].reshape(2, *[1] * angles.shape[1], -1) + 360.0 * turns)
    costs = np.where((np.abs(arrival) <= JUMP_DEGREES).all(-1), costs + (arrival**2).sum(-1), np.inf)
    away = 1 - _triple_of(last)
    costs[away][np.abs(arrival[away][..., 1]) > LOCK_STEP_DEGREES] = np.inf
    best = np.unravel_index(int(costs.argmin()), costs.shape)
    if not np.isfinite(costs[best]):
        return None
    out = np.empty_like(angles)
    triple, at = int(best[0]), np.array(best[1:])
    for frame in range(len(angles) - 1, -1, -1):
        out[frame] = triples[triple, frame] + 360.0 * (at - _TURNS)
        if frame and came_from[(frame, triple, *at)]:
            at = at - shifts[frame, triple]
            triple = 1 - triple
    return out


def through_lock(angles: np.ndarray, first: np.ndarray, last: np.ndarray, axes: str) -> np.ndarray | None:
    """The curve of a joint that stands at gimbal lock from key to key: there only the sum (or the difference) of the
    outer angles is determined, so each moves as little as it can.

    Args and returns: as `path_between`, of channels about `axes` ("ZXY", ...); None where some frame does not stand
        at gimbal lock, or the curve jumps.
    """
    if len(axes) != 3 or (np.abs(np.cos(np.deg2rad(angles[:, 1]))) >= LOCKED).any():
        return None
    share = np.linspace(0, 1, len(angles) + 2)[1:-1, None]
    line = first + share * (last - first)
    inner = angles.copy()
    inner[:, 1] -= 360.0 * np.round(angles[:, 1] / 360.0)
    made = [nearest_locked(frame, guide, parity_of(axes)) for frame, guide in zip(inner, line, strict=True)]
    curve = np.array(made)
    return curve if largest_step(curve, first, last) <= JUMP_DEGREES else None


def largest_step(curve: np.ndarray, first: np.ndarray, last: np.ndarray) -> float:
    """The largest step of any channel of a curve (M, n) between the keys' rows (n,), degrees."""
    return float(np.abs(np.diff(np.concatenate([first[None], curve, last[None]]), axis=0)).max())


def _two_triples(angles: np.ndarray, first: np.ndarray) -> np.ndarray:
    """(2, M, n) both triples of each frame, each a curve without jumps of a whole turn that starts near a key."""
    inner = np.array([_triple_of(frame) == 0 for frame in angles])[:, None]
    other = other_triple(angles)
    pair = np.stack([np.where(inner, angles, other), np.where(inner, other, angles)])
    pair += 360.0 * np.round((first - pair[:, :1]) / 360.0)
    return np.unwrap(pair, axis=1, period=360.0)


def _triple_of(angles: np.ndarray) -> int:
    """Which of the two triples angles (n,) are: 0 where the middle one lies within 90 degrees of a whole turn."""
    return int(abs(angles[1] - 360.0 * np.round(angles[1] / 360.0)) > 90.0)


def _step_cost(step: np.ndarray, *, crosses: bool = False) -> float:
    """The sum of squares of a step (n,); infinite for a jump. crosses: the step takes the other triple."""
    allowed = (np.abs(step) <= JUMP_DEGREES).all() and not (crosses and abs(step[1]) > LOCK_STEP_DEGREES)
    return float((step**2).sum()) if allowed else np.inf


def _shifted(costs: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Costs by whole turns, moved on by `turns` (n,) along each axis; what comes in is infinite."""
    out = np.full_like(costs, np.inf)
    into, start = [], []
    for size, by in zip(costs.shape, turns.tolist(), strict=True):
        by = max(-size, min(size, by))
        into.append(slice(max(by, 0), size + min(by, 0)))
        start.append(slice(max(-by, 0), size - max(by, 0)))
    out[tuple(into)] = costs[tuple(start)]
    return out
