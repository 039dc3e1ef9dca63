"""The spectral basis: eigenvectors of the graph Laplacian, in an order and with signs that do not vary."""

from __future__ import annotations

import networkx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_schemas.errors import InputError
from stages.shared.meshes.graph import graph_of, laplacian
from stages.shared.meshes.spectral_basis import compaction, spectral_basis
from tests.shared.meshes.shapes import ball, grid


@pytest.mark.parametrize("count", [40, 900])  # the whole decomposition, and shift-invert
def test_vectors_are_orthonormal_eigenvectors_in_order(count: int) -> None:
    _, faces = ball(count)
    basis, graph = spectral_basis(faces, count, 24)
    matrix = laplacian(graph.edges, count)
    vectors = basis.vectors.astype(np.float64)
    assert np.abs(vectors.T @ vectors - np.eye(24)).max() < 1e-5
    assert np.abs(matrix @ vectors - vectors * basis.values).max() < 1e-4
    assert (np.diff(basis.values) >= -1e-9).all()


def test_laplacian_is_that_of_networkx() -> None:
    _, faces = ball(60)
    graph = graph_of(faces, 60)
    other = networkx.Graph(graph.edges.tolist())
    assert np.array_equal(laplacian(graph.edges, 60).toarray(), networkx.laplacian_matrix(other, range(60)).toarray())


def test_shift_invert_agrees_with_the_whole_decomposition() -> None:
    _, faces = ball(700)
    basis, graph = spectral_basis(faces, 700, 12)
    values, vectors = np.linalg.eigh(laplacian(graph.edges, 700).toarray())
    assert np.abs(values[:12] - basis.values).max() < 1e-7
    alike = np.abs((vectors[:, :12] * basis.vectors).sum(axis=0))
    assert alike.min() > 1 - 1e-4


@settings(max_examples=20, deadline=None)
@given(st.integers(8, 60), st.integers(0, 10_000))
def test_all_eigenvectors_give_the_vertices_back(count: int, seed: int) -> None:
    vertices, faces = ball(count, seed)
    basis, _ = spectral_basis(faces, count, count)
    assert np.abs(basis.vertices(basis.coefficients(vertices)) - vertices).max() < 1e-5


def test_signs_and_order_are_fixed_from_call_to_call() -> None:
    _, faces = ball(800)
    one, other = (spectral_basis(faces, 800, 16)[0] for _ in range(2))
    assert np.array_equal(one.vectors, other.vectors)
    largest = np.abs(one.vectors).argmax(axis=0)
    assert (one.vectors[largest, np.arange(16)] > 0).all()


def test_rows_follow_the_vertices_when_they_are_numbered_anew() -> None:
    _vertices, faces = ball(50)
    new = np.random.default_rng(3).permutation(50)
    basis, _ = spectral_basis(faces, 50, 10)
    other, _ = spectral_basis(new[faces], 50, 10)
    moved = np.empty_like(basis.vectors)
    moved[new] = basis.vectors
    assert np.abs(np.abs(moved.T @ other.vectors) - np.eye(10)).max() < 1e-4


def test_every_component_has_its_mean_as_a_coefficient() -> None:
    one, faces = grid(5, 4)
    vertices = np.concatenate([one, one + 7])
    basis, graph = spectral_basis(np.concatenate([faces, faces + 20]), 40, 12)
    assert graph.pieces == 2 and "2 connected components" in graph.notes()[0]
    assert np.allclose(basis.values[:2], 0) and basis.values[2] > 1e-3
    means = basis.coefficients(vertices)[:2] / np.sqrt(20)
    assert np.allclose(means, [one.mean(axis=0), one.mean(axis=0) + 7], atol=1e-4)


def test_an_edge_of_three_triangles_is_said_and_harmless() -> None:
    faces = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]], np.int32)
    basis, graph = spectral_basis(faces, 5, 5)
    assert graph.crowded == 1 and "more than two triangles" in graph.notes()[0]
    assert np.abs(basis.vectors.T @ basis.vectors - np.eye(5)).max() < 1e-6


def test_more_eigenvectors_than_vertices_are_refused_in_one_sentence() -> None:
    _, faces = ball(20)
    with pytest.raises(InputError, match="21 eigenvectors are asked for, and a mesh of 20 vertices has 20"):
        spectral_basis(faces, 20, 21)


def test_fewer_eigenvectors_than_components_are_refused() -> None:
    _, faces = grid(3, 3)
    with pytest.raises(InputError, match="3 connected components, more than the 2 eigenvectors"):
        spectral_basis(np.concatenate([faces, faces + 9, faces + 18]), 27, 2)


def test_compaction_grows_with_k_to_the_whole_mesh() -> None:
    vertices, faces = ball(100)
    basis, _ = spectral_basis(faces, 100, 100)
    found = compaction(basis, vertices[None], (4, 16, 64, 100))
    assert [each.size for each in found] == [4, 16, 64, 100]
    assert (np.diff([each.energy for each in found]) > 0).all() and found[0].energy > 0.9
    assert found[-1].rmse_mm < 1e-2 and found[-1].energy == pytest.approx(1, abs=1e-6)
