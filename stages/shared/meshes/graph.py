"""The graph of a mesh: edges, components, and faults that a spectral basis does not forgive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components


@dataclass(frozen=True)
class MeshGraph:
    """What is known of a mesh's graph.

    edges:      (E, 2) int32, each once, the smaller vertex first, sorted.
    components: (N,) int32 which connected component a vertex is in, numbered by their first vertices.
    border:     edges of one triangle. crowded: edges of more than two, where the surface is not a manifold.
    alone:      vertices of no triangle.
    """

    edges: np.ndarray
    components: np.ndarray
    border: int
    crowded: int
    alone: int

    @property
    def pieces(self) -> int:
        """The number of connected components."""
        return int(self.components.max()) + 1

    def notes(self) -> list[str]:
        """Sentences on what a user should know: components, edges that are not a manifold's, vertices alone."""
        found = []
        if self.pieces > 1:
            found.append(
                f"The mesh has {self.pieces} connected components; each takes one eigenvector of eigenvalue 0, its "
                "mean position."
            )
        if self.crowded:
            found.append(
                f"{self.crowded} edges have more than two triangles; they do no harm to the graph Laplacian."
            )
        if self.alone:
            found.append(f"{self.alone} vertices are in no triangle; each is a component of its own.")
        return found


def edges_of(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges (E, 2) int32 of triangles (F, 3), each once and sorted, and how many triangles each has, (E,)."""
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges, counts = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)
    return edges.astype(np.int32), counts


def graph_of(faces: np.ndarray, count: int) -> MeshGraph:
    """The graph of triangles (F, 3) over `count` vertices."""
    edges, counts = edges_of(faces)
    _, labels = connected_components(adjacency(edges, count), directed=False)
    first = np.unique(labels, return_index=True)[1]
    order = np.argsort(np.argsort(first))
    return MeshGraph(
        edges,
        order[labels].astype(np.int32),
        int((counts == 1).sum()),
        int((counts > 2).sum()),
        count - len(np.unique(faces)),
    )


def adjacency(edges: np.ndarray, count: int) -> sparse.csr_matrix:
    """The adjacency matrix A (N, N) of edges (E, 2), float64."""
    both = np.concatenate([edges, edges[:, ::-1]])
    return sparse.csr_matrix((np.ones(len(both)), (both[:, 0], both[:, 1])), shape=(count, count))


def laplacian(edges: np.ndarray, count: int) -> sparse.csc_matrix:
    """The graph Laplacian L = D - A (N, N), float64; it needs the connectivity alone (SpecTrHuMS 3.1)."""
    matrix = adjacency(edges, count)
    degrees = np.asarray(matrix.sum(axis=1)).ravel()
    return sparse.csc_matrix(sparse.diags(degrees) - matrix)
