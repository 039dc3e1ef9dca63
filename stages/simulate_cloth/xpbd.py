"""Cloth by extended position-based dynamics (XPBD; Macklin et al. 2016), many simulations at once.

A step passes once over all constraints and several times over the threads (small steps, Macklin et al. 2019):
predict places from velocities and gravity, correct them by stretch, bending, tethers and contacts, and take the
velocities from the change. Places are held as (N, 3, S) for S simulations, so that a group of constraints is one
array operation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from stages.simulate_cloth.collisions import near_pairs
from stages.simulate_cloth.sheet import Sheet, coloured

GRAVITY = 9.81
_CONTACT_MARGIN = 1.3  # contacts act from this multiple of the thickness on; threads, solved later, undo some of it
_BROAD = 2.5  # candidates are searched up to this multiple of the contact distance
_DRAG = 0.4  # share of its velocity that cloth loses to the air in a second


@dataclass(frozen=True)
class Settings:
    """Numbers of the solver.

    step_s: of one step. thickness_m: least distance of two vertices without an edge.
    iterations: over the threads in a step.
    shear_compliance, bend_compliance: metres a newton of the diagonals and of opposite vertices; 0 would be stiff.
    """

    step_s: float = 1 / 2000
    iterations: int = 8
    thickness_m: float = 0.02
    shear_compliance: float = 0.02
    bend_compliance: float = 0.5


@dataclass(frozen=True)
class _Group:
    """Constraints without a common vertex: pairs (C,), (C,) and their lengths (C, 1)."""

    first: np.ndarray
    second: np.ndarray
    lengths: np.ndarray


def pins_of(sheet: Sheet, count: int, seed: int) -> np.ndarray:
    """(count, 2) two different vertices for each simulation, at least a fifth of the sheet's size apart."""
    rng = np.random.default_rng((seed, 5))
    far = 0.2 * np.ptp(sheet.vertices[:, 0])
    pins = np.empty((count, 2), int)
    for row in range(count):
        while True:
            one, other = rng.choice(len(sheet.vertices), 2, replace=False)
            if np.linalg.norm(sheet.vertices[one] - sheet.vertices[other]) > far:
                break
        pins[row] = one, other
    return pins


class ClothSolver:
    """S simulations of one sheet, each with its two pins.

    Args:
        pins: (S, 2) vertices that do not move.
    """

    def __init__(self, sheet: Sheet, pins: np.ndarray, settings: Settings):
        self.sheet, self.pins, self.settings = sheet, pins, settings
        sims, count = len(pins), len(sheet.vertices)
        self.places = np.repeat(sheet.vertices[:, :, None], sims, axis=2)
        self.velocities = np.zeros_like(self.places)
        self._inverse = np.repeat(1 / sheet.masses[:, None], sims, axis=1)  # (N, S)
        self._inverse[pins.T, np.arange(sims)] = 0.0
        self._threads = _groups(sheet.edges[: sheet.threads], sheet.lengths[: sheet.threads])
        self._shear = _groups(sheet.edges[sheet.threads :], sheet.lengths[sheet.threads :])
        self._bend = _groups(sheet.bends, sheet.bend_lengths)
        self._tethers = _tethers(sheet, pins)  # (2, N, S)
        self._anchors = np.stack([sheet.vertices[pins[:, which]].T for which in (0, 1)])  # (2, 3, S)
        linked = np.concatenate([sheet.edges, sheet.edges[:, ::-1]]).astype(np.int64)
        self._linked = np.unique(linked[:, 0] * count + linked[:, 1])
        self._candidates: tuple[np.ndarray, ...] | None = None
        self._travelled = np.inf

    def frames(self, count: int, fps: float) -> Iterator[np.ndarray]:
        """Places (S, N, 3) float64 metres of `count` frames, the flat sheet first."""
        steps = max(1, round(1 / fps / self.settings.step_s))
        for frame in range(count):
            if frame:
                for _ in range(steps):
                    self.step(1 / fps / steps)
            yield self.places.transpose(2, 0, 1).copy()

    def step(self, seconds: float) -> None:
        """Advance all simulations by one step."""
        before = self.places.copy()
        moving = (self._inverse > 0)[:, None]
        self.velocities[:, 1] -= GRAVITY * seconds
        self.velocities *= np.exp(-_DRAG * seconds)
        self.places += np.where(moving, self.velocities, 0.0) * seconds
        for group in self._bend:
            self._solve(group, self.settings.bend_compliance / seconds**2)
        for group in self._shear:
            self._solve(group, self.settings.shear_compliance / seconds**2)
        self._collide(before)
        self._tether()
        # Forwards and backwards, so that no group is always the last one, which would be met best.
        for turn in range(self.settings.iterations):
            for group in self._threads[:: 1 - 2 * (turn % 2)]:
                self._solve(group, 0.0)
        self.velocities = (self.places - before) / seconds

    def energy(self) -> np.ndarray:
        """Kinetic, gravitational, shear and bending energy (S,), joules."""
        masses = self.sheet.masses[:, None]
        kinetic = 0.5 * (masses * (self.velocities**2).sum(1)).sum(0)
        high = (masses * GRAVITY * self.places[:, 1]).sum(0)
        sheet, total = self.sheet, kinetic + high
        for pairs, lengths, compliance in (
            (sheet.bends, sheet.bend_lengths, self.settings.bend_compliance),
            (sheet.edges[sheet.threads :], sheet.lengths[sheet.threads :], self.settings.shear_compliance),
        ):
            apart = np.linalg.norm(self.places[pairs[:, 0]] - self.places[pairs[:, 1]], axis=1) - lengths[:, None]
            total = total + 0.5 * (apart**2).sum(0) / compliance
        return total

    def _solve(self, group: _Group, compliance: float) -> None:
        """XPBD's correction for distances, with its multiplier starting at 0 in each step."""
        one, other = self.places[group.first], self.places[group.second]
        inverse_one, inverse_other = self._inverse[group.first], self._inverse[group.second]
        apart = one - other
        length = np.sqrt((apart * apart).sum(1))
        scale = (length - group.lengths) / np.maximum(length * (inverse_one + inverse_other + compliance), 1e-12)
        apart *= scale[:, None]
        self.places[group.first] = one - apart * inverse_one[:, None]
        self.places[group.second] = other + apart * inverse_other[:, None]

    def _tether(self) -> None:
        """Hold every vertex within its way along threads from each pin (long range attachments, Kim et al. 2012)."""
        for which in (0, 1):
            apart = self.places - self._anchors[which]
            length = np.sqrt((apart * apart).sum(1))
            over = np.maximum(1 - self._tethers[which] / np.maximum(length, 1e-12), 0.0)
            over[self._inverse == 0] = 0.0
            self.places -= apart * over[:, None]

    def _collide(self, before: np.ndarray) -> None:
        """Push apart vertices nearer than the contact distance, averaged over a vertex's pairs.

        The push changes places and not velocities: `before` is moved as well. Of the velocities only the approach is
        taken away. So contacts add no kinetic energy.
        """
        reach = _CONTACT_MARGIN * self.settings.thickness_m
        self._travelled += 2 * np.sqrt(((self.places - before) ** 2).sum(1).max())
        if self._candidates is None or self._travelled > (_BROAD - 1) * reach:
            sims, one, other = near_pairs(self.places.transpose(2, 0, 1), _BROAD * reach)
            free = ~np.isin(one * len(self.places) + other, self._linked)
            self._candidates, self._travelled = (sims[free], one[free], other[free]), 0.0
        sims, one, other = self._candidates
        apart = self.places[one, :, sims] - self.places[other, :, sims]
        length = np.sqrt((apart * apart).sum(1))
        near = length < reach
        if not near.any():
            return
        sims, one, other, apart, length = sims[near], one[near], other[near], apart[near], length[near]
        normal = apart / np.maximum(length, 1e-12)[:, None]
        moved = self.places - before
        approach = np.minimum(((moved[one, :, sims] - moved[other, :, sims]) * normal).sum(1), 0.0)
        inverse = np.stack([self._inverse[one, sims], -self._inverse[other, sims]])
        inverse /= np.maximum(np.abs(inverse).sum(axis=0), 1e-12)
        many = np.zeros_like(self._inverse)
        np.add.at(many, (one, sims), 1.0)
        np.add.at(many, (other, sims), 1.0)
        for amount, parts in ((reach - length, (self.places, before)), (-approach, (self.places,))):
            change = np.zeros_like(self.places)
            push = normal * amount[:, None]
            np.add.at(change.transpose(0, 2, 1), (one, sims), push * inverse[0][:, None])
            np.add.at(change.transpose(0, 2, 1), (other, sims), push * inverse[1][:, None])
            change /= np.maximum(many, 1.0)[:, None]
            for part in parts:
                part += change


def _groups(pairs: np.ndarray, lengths: np.ndarray) -> list[_Group]:
    return [_Group(pairs[chosen, 0], pairs[chosen, 1], lengths[chosen][:, None]) for chosen in coloured(pairs)]


def _tethers(sheet: Sheet, pins: np.ndarray) -> np.ndarray:
    """(2, N, S) shortest way along threads from each vertex to each pin, metres."""
    count = len(sheet.vertices)
    graph = sparse.csr_matrix(
        (sheet.lengths[: sheet.threads], tuple(sheet.edges[: sheet.threads].T)), shape=(count, count)
    )
    return np.stack([dijkstra(graph, directed=False, indices=pins[:, which]).T for which in (0, 1)])
