"""Self-collision of cloth: pairs of vertices that are near each other, by a spatial hash.

All S simulations of a batch are hashed at once: a cell's key has the simulation's number in it.
"""

from __future__ import annotations

import numpy as np

# Half of the 27 neighbouring cells: each pair of cells is looked at from one side.
_AROUND = np.array(
    [
        (0, 0, 0), (1, 0, 0), (-1, 1, 0), (0, 1, 0), (1, 1, 0), (-1, -1, 1), (0, -1, 1), (1, -1, 1), (-1, 0, 1),
        (0, 0, 1), (1, 0, 1), (-1, 1, 1), (0, 1, 1), (1, 1, 1),
    ]
)  # fmt: skip
_SPAN = 1 << 9  # cells along each axis; cloth beyond them would be many metres away


def near_pairs(places: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of vertices nearer to each other than `reach`.

    Args:
        places: (S, N, 3) metres.

    Returns: simulation, first and second vertex of each pair, first < second, each pair once.
    """
    sims, count, _ = places.shape
    cells = np.floor(places / reach).astype(np.int64)
    cells -= cells.min(axis=(0, 1))
    cells = np.clip(cells, 0, _SPAN - 3) + 1
    number = np.arange(sims)[:, None]

    def keys(of: np.ndarray) -> np.ndarray:
        return ((number * _SPAN + of[..., 0]) * _SPAN + of[..., 1]) * _SPAN + of[..., 2]

    flat = keys(cells).ravel()
    order = np.argsort(flat, kind="stable")
    ordered = flat[order]
    places = places.reshape(-1, 3)
    firsts, seconds = [], []
    for step in _AROUND:
        wanted = flat if not step.any() else keys(cells + step).ravel()
        begin = np.searchsorted(ordered, wanted, side="left")
        many = np.searchsorted(ordered, wanted, side="right") - begin
        one = np.repeat(np.arange(len(flat)), many)
        within = np.arange(len(one)) - np.repeat(np.cumsum(many) - many, many)
        other = order[np.repeat(begin, many) + within]
        if not step.any():
            keep = one < other
            one, other = one[keep], other[keep]
        close = ((places[one] - places[other]) ** 2).sum(1) < reach * reach
        firsts.append(np.minimum(one, other)[close])
        seconds.append(np.maximum(one, other)[close])
    first, second = np.concatenate(firsts), np.concatenate(seconds)
    return first // count, first % count, second % count


def near_pairs_plain(places: np.ndarray, reach: float) -> set[tuple[int, int, int]]:
    """The same pairs, by comparing all vertices with all: the slow reference."""
    found = set()
    for sim, mesh in enumerate(places):
        apart = np.linalg.norm(mesh[:, None] - mesh[None], axis=-1)
        found |= {(sim, int(a), int(b)) for a, b in zip(*np.nonzero(np.triu(apart < reach, 1)), strict=True)}
    return found
