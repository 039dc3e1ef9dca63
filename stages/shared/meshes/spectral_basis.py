"""The eigenvectors of a mesh's graph Laplacian, and the transforms to and from spectral coefficients.

SpecTrHuMS 3.1, eq. 1: C = Phi^T V and V = Phi C. The basis depends on the connectivity alone, so that all meshes of
one connectivity share it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh

from data_schemas.errors import InputError
from data_schemas.mesh import connectivity_digest
from stages.shared.meshes.graph import MeshGraph, graph_of, laplacian

_SHIFT = -1e-3  # below every eigenvalue, so that the shifted matrix is positive definite
_DENSE_BELOW = 600  # vertices; a whole decomposition is faster there
_ZERO = 1e-8


@dataclass(frozen=True)
class SpectralBasis:
    """k eigenvectors of a graph of N vertices.

    values:  (k,) float64 eigenvalues, ascending. vectors: (N, k) float32, orthonormal.
    digest:  of the connectivity.
    """

    values: np.ndarray
    vectors: np.ndarray
    digest: str

    @property
    def size(self) -> int:
        """k."""
        return len(self.values)

    def coefficients(self, vertices: np.ndarray) -> np.ndarray:
        """Spectral coefficients (..., k, 3) of vertices (..., N, 3)."""
        return np.einsum("nk,...nd->...kd", self.vectors, vertices, optimize=True)

    def vertices(self, coefficients: np.ndarray) -> np.ndarray:
        """Vertices (..., N, 3) of spectral coefficients (..., k, 3); fewer than k are taken as the lowest."""
        return np.einsum("nk,...kd->...nd", self.vectors[:, : coefficients.shape[-2]], coefficients, optimize=True)


def spectral_basis(faces: np.ndarray, count: int, size: int) -> tuple[SpectralBasis, MeshGraph]:
    """The `size` eigenvectors of the lowest eigenvalues, and the graph.

    Signs: the entry of largest magnitude (the first of equal ones) is positive. Order: by eigenvalue. Of eigenvalue 0
    there is one vector for each connected component, constant on it, in the order of the components' first vertices.
    Within another eigenvalue that occurs several times, a basis is not determined by the graph; it is by the seed.

    Args:
        faces: (F, 3) triangles. count: N. size: k, at most N.

    Raises: InputError if k is not within 1 to N, or is too small for the components.
    """
    if not 1 <= size <= count:
        raise InputError(
            f"{size} eigenvectors are asked for, and a mesh of {count} vertices has {count}.",
            f"Ask for 1 to {count}.",
        )
    graph = graph_of(faces, count)
    if graph.pieces > size:
        raise InputError(
            f"The mesh has {graph.pieces} connected components, more than the {size} eigenvectors asked for.",
            "Remove the loose parts, or ask for more eigenvectors.",
        )
    matrix = laplacian(graph.edges, count)
    if count <= _DENSE_BELOW or size > count - 2:
        values, vectors = eigh(matrix.toarray(), subset_by_index=[0, size - 1])
    else:
        start = np.random.default_rng(0).normal(size=count)
        values, vectors = eigsh(matrix, k=size, sigma=_SHIFT, which="LM", v0=start)
    order = np.argsort(values, kind="stable")
    values, vectors = values[order], vectors[:, order]
    values, vectors = _constant_on_components(values, vectors, graph)
    return SpectralBasis(values, _signed(vectors).astype(np.float32), connectivity_digest(faces, count)), graph


def _constant_on_components(
    values: np.ndarray, vectors: np.ndarray, graph: MeshGraph
) -> tuple[np.ndarray, np.ndarray]:
    """The space of eigenvalue 0 in its own basis: the components' indicators, of unit length."""
    indicators = np.zeros((len(vectors), graph.pieces))
    indicators[np.arange(len(vectors)), graph.components] = 1.0
    indicators /= np.linalg.norm(indicators, axis=0)
    rest = vectors[:, graph.pieces :]
    rest = rest - indicators @ (indicators.T @ rest)
    rest, _ = np.linalg.qr(rest) if rest.shape[1] else (rest, None)
    values = np.concatenate([np.zeros(graph.pieces), np.maximum(values[graph.pieces :], _ZERO)])
    return values, np.concatenate([indicators, rest], axis=1)


def _signed(vectors: np.ndarray) -> np.ndarray:
    """Each column times 1 or -1, so that its entry of largest magnitude is positive.

    Magnitudes are compared to 1e-6: of two that rounding alone tells apart, the first counts.
    """
    sizes = np.abs(vectors)
    first = np.argmax(sizes > sizes.max(axis=0) - 1e-6, axis=0)
    signs = np.sign(vectors[first, np.arange(vectors.shape[1])])
    return vectors * np.where(signs == 0, 1.0, signs)


@dataclass(frozen=True)
class Compaction:
    """How much of a mesh the lowest k coefficients hold.

    energy: their share of the energy of the coordinates about their mean. rmse_mm, worst_mm: distance of the rebuilt
    vertices from the true ones, root mean square and greatest.
    """

    size: int
    energy: float
    rmse_mm: float
    worst_mm: float


def compaction(basis: SpectralBasis, vertices: np.ndarray, sizes: tuple[int, ...]) -> list[Compaction]:
    """Energy compaction and error of reconstruction against k, over meshes (T, N, 3) metres."""
    coefficients = basis.coefficients(vertices)
    centred = vertices - vertices.mean(axis=1, keepdims=True)
    energy = float((centred.astype(np.float64) ** 2).sum())
    found = []
    for size in (size for size in sizes if size <= basis.size):
        apart = np.linalg.norm(basis.vertices(coefficients[:, :size]) - vertices, axis=-1)
        left = float((apart.astype(np.float64) ** 2).sum())
        found.append(
            Compaction(size, 1 - left / energy, 1e3 * float(np.sqrt((apart**2).mean())), 1e3 * float(apart.max()))
        )
    return found
