"""A flat, asymmetric sheet of cloth: its vertices, triangles and constraints (SpecTrHuMS 4.6.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.shared.meshes.graph import edges_of
from stages.shared.meshes.measures import edge_lengths


@dataclass(frozen=True)
class Sheet:
    """A sheet at rest, in the plane Y = 0.

    vertices: (N, 3) float64 metres. faces: (F, 3) int32.
    edges:    (E, 2) of the triangles: threads, then diagonals. lengths: (E,) metres.
    threads:  how many of them are threads, warp and weft, which keep their length. The diagonals resist shear softly:
              a sheet whose triangles could not change at all would only bend along straight lines.
    bends:    (B, 2) vertices opposite an inner edge, whose distance resists bending. bend_lengths: (B,) metres.
    masses:   (N,) kilograms. area: square metres.
    """

    vertices: np.ndarray
    faces: np.ndarray
    edges: np.ndarray
    lengths: np.ndarray
    threads: int
    bends: np.ndarray
    bend_lengths: np.ndarray
    masses: np.ndarray
    area: float


def make_sheet(rows: int = 22, size_m: float = 1.0, density: float = 0.2, seed: int = 0) -> Sheet:
    """A sheet of rows x rows vertices; 22 make the 484 of the paper.

    Its outline has no symmetry (the upper side slants and the sides curve differently), inner vertices are moved a
    little at random, and diagonals alternate at random, so that no two pins make the same cloth.

    Args:
        size_m: length of a side, about. density: kilograms a square metre.
    """
    rng = np.random.default_rng((seed, 3))
    v, u = np.mgrid[:rows, :rows] / (rows - 1)
    x = u * (1 - 0.18 * v) + 0.10 * v * np.sin(2.1 * v)
    z = v * (0.82 + 0.22 * u * u) + 0.05 * np.sin(2.7 * u)
    step = 1 / (rows - 1)
    inner = np.zeros_like(u, bool)
    inner[1:-1, 1:-1] = True
    x, z = (part + inner * rng.uniform(-0.15, 0.15, part.shape) * step for part in (x, z))
    vertices = size_m * np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1)
    corner = (np.arange(rows - 1)[:, None] * rows + np.arange(rows - 1)).ravel()
    a, b, c, d = corner, corner + 1, corner + rows, corner + rows + 1
    flip = rng.random(len(corner)) < 0.5
    first = np.where(flip[:, None], np.stack([a, c, b], 1), np.stack([a, c, d], 1))
    second = np.where(flip[:, None], np.stack([b, c, d], 1), np.stack([a, d, b], 1))
    faces = np.concatenate([first, second]).astype(np.int32)
    edges = _threads_first(edges_of(faces)[0], rows)
    threads = 2 * rows * (rows - 1)
    bends = opposite_pairs(faces)
    corners = vertices[faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    masses = np.zeros(len(vertices))
    np.add.at(masses, faces.ravel(), np.repeat(density * areas / 3, 3))
    return Sheet(
        vertices, faces, edges, edge_lengths(vertices, edges), threads, bends, edge_lengths(vertices, bends), masses,
        float(areas.sum()),
    )  # fmt: skip


def _threads_first(edges: np.ndarray, rows: int) -> np.ndarray:
    """The edges of a sheet with those along rows and columns before the diagonals."""
    apart = edges[:, 1] - edges[:, 0]
    along = (apart == rows) | ((apart == 1) & (edges[:, 1] % rows != 0))
    return np.concatenate([edges[along], edges[~along]])


def opposite_pairs(faces: np.ndarray) -> np.ndarray:
    """(B, 2) for each edge of two triangles, the two vertices that are not on it."""
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    opposite = np.concatenate([faces[:, 2], faces[:, 0], faces[:, 1]])
    order = np.lexsort((sides.max(1), sides.min(1)))
    keys = np.sort(sides, axis=1)[order]
    same = np.flatnonzero((keys[1:] == keys[:-1]).all(axis=1))
    return np.stack([opposite[order[same]], opposite[order[same + 1]]], axis=1)


def coloured(pairs: np.ndarray) -> list[np.ndarray]:
    """Indices of the pairs in groups in which no vertex occurs twice, so that a group is solved at once.

    Each pair gets the smallest colour that no pair before it has at either vertex.
    """
    used: dict[int, set[int]] = {}
    colours = np.empty(len(pairs), int)
    for index, (one, other) in enumerate(pairs.tolist()):
        taken = used.setdefault(one, set()) | used.setdefault(other, set())
        colour = next(number for number in range(len(taken) + 1) if number not in taken)
        colours[index] = colour
        used[one].add(colour)
        used[other].add(colour)
    return [np.flatnonzero(colours == colour) for colour in range(int(colours.max()) + 1)]
