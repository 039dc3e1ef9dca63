"""The fit: trust as a factor on corrections, by least squares, each bin drawn towards the wider one it lies in.

For a gap's token of depth d, with corrections x and what they should have been y, the model is
y = ((1 - d) * edge + d * middle) * x: two numbers for each bin. Each archive weighs the same; the trust that is kept
is the least of the fits that leave one archive out, so that no one family of skeletons is what it hangs on.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from stages.inference.confidence import SHAPE

BINS = SHAPE[:-1]
_TINY = 1e-12


@dataclass
class Sums:
    """Normal equations of every bin: squares (bins, 2, 2), products (bins, 2), windows heard (bins), and the power of
    what corrections should have been (bins)."""

    squares: np.ndarray = field(default_factory=lambda: np.zeros((*BINS, 2, 2)))
    products: np.ndarray = field(default_factory=lambda: np.zeros((*BINS, 2)))
    heard: np.ndarray = field(default_factory=lambda: np.zeros(BINS))
    power: np.ndarray = field(default_factory=lambda: np.zeros(BINS))

    def add(self, bins: tuple[int, int, int], depth: np.ndarray, made: np.ndarray, true: np.ndarray) -> None:
        """A gap of one part: depth (n,), corrections made and true (n, ..., 3)."""
        if not made.size:
            return
        made, true = made.reshape(len(depth), -1), true.reshape(len(depth), -1)
        nodes = np.stack([1 - depth, depth])
        self.squares[bins] += (nodes[:, None] * nodes[None]) @ (made**2).sum(1)
        self.products[bins] += nodes @ (made * true).sum(1)
        self.heard[bins] += 1
        self.power[bins] += float((true**2).sum())

    def scaled(self) -> Sums:
        """As heavy as any other: the corrections made have one power in all."""
        whole = max(float(np.trace(self.squares, axis1=-2, axis2=-1).sum()), _TINY)
        return Sums(self.squares / whole, self.products / whole, self.heard, self.power / whole)


def total(parts: list[Sums]) -> Sums:
    """All of them together."""
    return Sums(*(np.sum([getattr(part, name) for part in parts], axis=0) for name in vars(Sums())))


def fit(parts: list[Sums], prior: float) -> np.ndarray:
    """Trust SHAPE of archives that weigh alike."""
    whole = total([part.scaled() for part in parts])
    trust = np.broadcast_to(_solved(whole, (0, 1, 2), None, prior), SHAPE)
    for summed in ((1, 2), (2,), ()):  # by gap; by gap and part; by gap, part and size
        trust = np.broadcast_to(_solved(whole, summed, trust, prior), SHAPE)
    return np.clip(trust, 0, 1)


def careful_fit(archives: dict[str, Sums], prior: float) -> np.ndarray:
    """The least trust of the fits that leave one archive out; of a single archive its own fit."""
    if len(archives) < 2:
        return fit(list(archives.values()), prior)
    return np.min([fit([s for other, s in archives.items() if other != name], prior) for name in archives], axis=0)


def gain(sums: Sums, trust: np.ndarray) -> float:
    """The share of what corrections should have been, in squares, that they are right about: 1 is all, below 0 is
    harm."""
    wrong = np.einsum("...ij,...i,...j->...", sums.squares, trust, trust) - 2 * (sums.products * trust).sum(-1)
    return float(-wrong.sum() / max(float(sums.power.sum()), _TINY))


def _solved(whole: Sums, summed: tuple[int, ...], wider: np.ndarray | None, prior: float) -> np.ndarray:
    """Least squares of bins added up over some axes, drawn towards `wider` as if `prior` more gaps had said that."""
    squares, products, heard = (
        values.sum(axis=summed, keepdims=True) for values in (whole.squares, whole.products, whole.heard)
    )
    ridge = np.trace(squares, axis1=-2, axis2=-1)[..., None] / 2
    ridge = np.where(heard[..., None] > 0, ridge * prior / np.maximum(heard[..., None], 1), 1.0) + _TINY
    towards = np.zeros(products.shape) if wider is None else _mean(wider, summed)
    return np.linalg.solve(squares + ridge[..., None] * np.eye(2), (products + ridge * towards)[..., None])[..., 0]


def _mean(trust: np.ndarray, summed: tuple[int, ...]) -> np.ndarray:
    return trust.mean(axis=summed, keepdims=True) if summed else trust
