"""The fit: trust as a factor on corrections, by least squares of joint positions.

For a gap's token of depth d, the body part p has the trust (1 - d) * edge + d * middle, two numbers for each bin.
Corrections of a part move all joints further out, and rotations of one part compensate for those of another. So all
bins are fitted together, to positions (and, with a small weight, to angles), and not each to its own angles. A bin is
shrunk towards the wider bin that contains it: that of its part and length, and this towards that of its part. Each
archive has the same weight. Of two fits, the one that is better on archives left out of it is kept: the fit of all
archives, or the least trust of the fits that leave one archive out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from stages.shared.inference.confidence import SHAPE

_LENGTHS, _PARTS, _SIZES, _NODES = SHAPE
_COUNT = int(np.prod(SHAPE))
_TINY = 1e-12


@dataclass
class Sums:
    """Normal equations of all bins' trust, in the order of a table of `SHAPE` laid out flat: squares (n, n), products
    (n,), numbers of gaps `counts` (n,); and the power of the ideal corrections."""

    squares: np.ndarray = field(default_factory=lambda: np.zeros((_COUNT, _COUNT)))
    products: np.ndarray = field(default_factory=lambda: np.zeros(_COUNT))
    counts: np.ndarray = field(default_factory=lambda: np.zeros(_COUNT))
    power: float = 0.0

    def add(
        self, length_bin: int, size_bins: Sequence[int], depth: np.ndarray, made: np.ndarray, wanted: np.ndarray
    ) -> None:
        """A gap.

        Args:
            length_bin, size_bins: the gap's, and each part's.
            depth: (n,) of its tokens. made: (parts, n, C) the change from each part's corrections alone.
            wanted: (n, C) the ideal change from all parts together.
        """
        nodes = np.stack([1 - depth, depth])
        columns = (nodes[None, :, :, None] * made[:, None]).reshape(_PARTS * _NODES, -1).astype(np.float64)
        bins = [
            np.ravel_multi_index((length_bin, part, size, node), SHAPE)
            for part, size in enumerate(size_bins)
            for node in range(_NODES)
        ]
        target = wanted.reshape(-1).astype(np.float64)
        self.squares[np.ix_(bins, bins)] += columns @ columns.T
        self.products[bins] += columns @ target
        self.counts[bins] += 1
        self.power += float(target @ target)

    def scaled(self) -> Sums:
        """Normalised to the weight of the others: the ideal corrections have a total power of one."""
        whole = max(self.power, _TINY)
        return Sums(self.squares / whole, self.products / whole, self.counts, self.power / whole)


def total(parts: Sequence[Sums]) -> Sums:
    """The sum of all equations."""
    return Sums(
        np.sum([part.squares for part in parts], axis=0),
        np.sum([part.products for part in parts], axis=0),
        np.sum([part.counts for part in parts], axis=0),
        sum(part.power for part in parts),
    )


def fit(parts: Sequence[Sums], prior: float, start: np.ndarray | None = None) -> np.ndarray:
    """Trust SHAPE of archives with equal weights: first of the body's parts, then of the gap's length, then of its
    size. Each bin is fitted with `prior` more gaps that agree with the wider bin; for the widest bins these gaps have
    the trust `start` SHAPE, or without one none."""
    whole = total([part.scaled() for part in parts])
    trust = np.zeros(_COUNT) if start is None else start.reshape(-1).astype(np.float64)
    for level in _levels():
        left = level.T @ (whole.products - whole.squares @ trust)
        squares, counts = level.T @ whole.squares @ level, level.T @ whole.counts
        ridge = np.diag(squares) * prior / np.maximum(counts, 1) + _TINY
        trust += level @ np.linalg.solve(squares + np.diag(ridge), left)
    return np.clip(trust.reshape(SHAPE), 0, 1)


def careful_fit(archives: dict[str, Sums], prior: float) -> np.ndarray:
    """The least trust of the fits that leave one archive out; for a single archive its own fit."""
    if len(archives) < 2:
        return joint_fit(archives, prior)
    return np.min([fit([s for other, s in archives.items() if other != name], prior) for name in archives], axis=0)


def joint_fit(archives: dict[str, Sums], prior: float) -> np.ndarray:
    """The trust of all archives together."""
    return fit(list(archives.values()), prior)


def trust_fit(archives: dict[str, Sums], prior: float) -> np.ndarray:
    """The trust SHAPE that is kept: `joint_fit` or `careful_fit`, whichever is better on archives left out.

    The careful fit is for weights that know only some families of skeletons. If they know all equally well, it loses
    a tenth of their gain.
    """
    if len(archives) < 2:
        return joint_fit(archives, prior)
    return max((joint_fit, careful_fit), key=lambda way: _gain_left_out(way, archives, prior))(archives, prior)


def _gain_left_out(way: Callable[..., np.ndarray], archives: dict[str, Sums], prior: float) -> float:
    gains = [
        gain(sums, way({other: each for other, each in archives.items() if other != name}, prior))
        for name, sums in archives.items()
    ]
    return float(np.mean(gains))


def gain(sums: Sums, trust: np.ndarray) -> float:
    """The share of the ideal corrections, in squares, that the corrections achieve: 1 is all, below 0 is a loss."""
    flat = trust.reshape(-1)
    return float((2 * flat @ sums.products - flat @ sums.squares @ flat) / max(sums.power, _TINY))


def _levels() -> list[np.ndarray]:
    """(n, m) zeros and ones, the m wider bins that contain each bin: of parts; of lengths and parts; and itself."""
    lengths, parts, sizes, nodes = np.indices(SHAPE).reshape(len(SHAPE), -1)
    by_part = parts * _NODES + nodes
    by_length = (lengths * _PARTS + parts) * _NODES + nodes
    own = ((lengths * _PARTS + parts) * _SIZES + sizes) * _NODES + nodes
    return [np.eye(each.max() + 1)[each] for each in (by_part, by_length, own)]
