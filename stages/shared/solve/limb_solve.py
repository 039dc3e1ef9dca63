"""A limb whose end follows a path: turns of its joints over time, all frames at once, each with its neighbours.

The unknowns are a rotation vector for every joint of the limb and frame, in the joint's own frame after its base
rotation. Their cost, with e the limb's end, s the shift that is wanted of it and P the joints' turn prior
(`stages.shared.solve.key_prior`), which keeps a hinge on its axis:

    sum over t of |e(t) - e_base(t) - s(t)|^2 / noise^2 + turn' P turn + span^4 (turn'')' P turn''

The last term bounds how fast corrections come and go, also where a straight limb would have the turns leap. Frames
are solved together by Gauss-Newton. The matrix is banded, so that the cost grows with the number of frames. Before
the solve, `within_reach` moves places that the limb cannot reach, or reaches only when straight, towards its first
joint.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stages.shared.kinematics.rotations import from_turn_vectors, multiply, rotate
from stages.shared.solve.bending import SecondDerivative, solve_bands

PINNED = 1e9  # precision of turns that must stay zero
# Of a limb's length: the farthest place, and the length before it over which places move in.
REACH, SOFT = 0.995, 0.02
SMALL = 1e-9
CLOSE_RAD = 3e-4  # a step that is smaller than this is the last one


@dataclass(frozen=True)
class Limb:
    """A chain of n joints over T frames, float64, and its end, which rides on the last of them.

    local:   (T, n, 4) rotations in the parents' frames, xyzw; the first joint's parent has `above` (T, 4).
    top:     (T, 3) the first joint's place, metres.
    offsets: (T, n, 3) from each joint to the next, or to the end, in the joint's frame.
    """

    local: np.ndarray
    above: np.ndarray
    top: np.ndarray
    offsets: np.ndarray

    def rows(self, rows: slice) -> Limb:
        """Some of the frames."""
        return Limb(self.local[rows], self.above[rows], self.top[rows], self.offsets[rows])

    @cached_property
    def by_itself(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What `turned` gives without turns."""
        return self.turned(np.zeros(self.offsets.shape))

    def turned(self, turns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Global rotations (T, n, 4), joints' places (T, n, 3) and the end's (T, 3), with turns (T, n, 3) added."""
        local = multiply(self.local, from_turn_vectors(turns))
        rotations, places = np.empty_like(local), np.empty((*local.shape[:2], 3))
        above, place = self.above, self.top
        for joint in range(local.shape[1]):
            places[:, joint] = place
            rotations[:, joint] = above = multiply(above, local[:, joint])
            place = place + rotate(above, self.offsets[:, joint])
        return rotations, places, place


def within_reach(limb: Limb, ends: np.ndarray) -> np.ndarray:
    """Places (T, 3) of a limb's end, drawn towards its first joint as far as they would straighten it.

    The limb may reach up to `REACH` of its length, or as far as it reaches by itself. Over
    the last `SOFT` of its length before that, places are moved in more and more, so that the limb slows down before
    it stops.
    """
    length = np.linalg.norm(limb.offsets, axis=-1).sum(1)
    own = np.linalg.norm(limb.by_itself[2] - limb.top, axis=-1)
    most = np.maximum(REACH * length, own)
    away = ends - limb.top
    distance = np.linalg.norm(away, axis=-1)
    soft = SOFT * length
    begin = most - soft
    over = np.maximum(distance - begin, 0) / soft
    # From `begin` on with slope 1 to 0 at `most`; what the limb reaches by itself stays as it is.
    drawn = np.where(distance > begin, begin + soft * (1 - np.exp(-over)), distance)
    allowed = np.where(own > begin, np.maximum(drawn, np.minimum(own, distance)), drawn)
    return limb.top + away * (allowed / np.maximum(distance, SMALL))[:, None]


def solve_limb(
    limb: Limb,
    shifts: np.ndarray,
    prior: np.ndarray,
    pinned: np.ndarray,
    *,
    noise_m: float,
    span: float,
    start: np.ndarray | None = None,
    iterations: int = 6,
    longest_step: float = np.inf,
) -> np.ndarray:
    """Turns (T, n, 3) that shift a limb's end.

    Args:
        shifts: (T, 3) wanted of the end in the world, metres.
        prior: (n, 3, 3) precision of the turns, 1 / radians^2.
        pinned: (T,) bool, frames in which the limb keeps its turns of `start`; or (T, n), joints that do.
        noise_m: expected distance of the end from its place, metres.
        span: frames over which corrections come and go.
        start: (T, n, 3) turns to begin with, and the turns of pinned frames; None for no turns. Those of similar
            shifts save iterations.
        longest_step: radians that a joint may turn about an axis in one iteration; shifts of half a limb's length
            and more need a bound.
    """
    frames, joints = limb.local.shape[:2]
    start = np.zeros((frames, joints, 3)) if start is None else start
    turns = start
    ends = within_reach(limb, limb.by_itself[2] + shifts)
    own = np.zeros((3 * joints, 3 * joints))
    for joint in range(joints):
        own[3 * joint : 3 * joint + 3, 3 * joint : 3 * joint + 3] = prior[joint]
    derivative = SecondDerivative.at(np.arange(float(max(frames, 2))))
    stiff = span**4 * derivative.squared(derivative.width)[:, :frames]
    stiff[0] += 1.0
    base = _banded(stiff, own)
    size = 3 * joints
    stays = np.repeat(pinned if pinned.ndim == 2 else np.repeat(pinned[:, None], joints, axis=1), 3, axis=1)
    base[0].reshape(frames, size)[stays] += PINNED
    for _ in range(iterations):
        rotations, places, end = limb.turned(turns)
        slopes = _slopes(rotations, end[:, None] - places).reshape(frames, size, 3) / noise_m
        missed = (ends - end) / noise_m
        bands = base.copy()
        _add_blocks(bands, slopes @ slopes.transpose(0, 2, 1))
        pull = (slopes @ missed[..., None])[..., 0] - _times(stiff, turns.reshape(frames, size) @ own)
        pull[stays] = 0.0
        step = solve_bands(bands, pull.ravel()).reshape(turns.shape)
        if np.isfinite(longest_step):
            step = step / np.maximum(1.0, np.abs(step).max(axis=(1, 2), keepdims=True) / longest_step)
        turns = turns + step
        if np.abs(step).max() < CLOSE_RAD:
            break
    turns[pinned] = start[pinned]
    return turns


def _slopes(rotations: np.ndarray, arms: np.ndarray) -> np.ndarray:
    """(T, n, 3, 3) d end / d turn, metres per radian: for each joint and each of its axes, the cross product of the
    axis in the world and the arm.

    Component by component, since np.cross takes longer on short clips.

    Args:
        rotations: (T, n, 4) of the joints, global. arms: (T, n, 3) from the joints to the end, metres.
    """
    x, y, z, w = (rotations[..., part] for part in range(4))
    axes = (
        (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
        (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
        (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
    )
    a, b, c = (arms[..., part] for part in range(3))
    slopes = np.empty((*arms.shape, 3))
    for axis, (p, q, r) in enumerate(axes):
        slopes[..., axis, 0], slopes[..., axis, 1], slopes[..., axis, 2] = q * c - r * b, r * a - p * c, p * b - q * a
    return slopes


def _times(bands: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A symmetric matrix of bands (3, T) times values (T, F)."""
    out = bands[0][:, None] * values
    for away in (1, 2):
        band = bands[away][: len(values) - away, None]
        out[away:] += band * values[:-away]
        out[:-away] += band * values[away:]
    return out


def _banded(bands: np.ndarray, block: np.ndarray) -> np.ndarray:
    """LAPACK's lower bands of the Kronecker product of a symmetric matrix of bands (3, T) and a block (m, m)."""
    size, frames = len(block), bands.shape[1]
    out = np.zeros((3 * size, frames * size))
    for away in range(3):
        for row in range(size):
            for column in range(size):
                if (below := away * size + row - column) >= 0:
                    out[below, column::size] += bands[away] * block[row, column]
    return out


def _add_blocks(bands: np.ndarray, blocks: np.ndarray) -> None:
    """Add symmetric blocks (T, m, m) on the diagonal."""
    size = blocks.shape[1]
    for row in range(size):
        for column in range(row + 1):
            bands[row - column, column::size] += blocks[:, row, column]
