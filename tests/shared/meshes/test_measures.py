"""Measures of meshes, the joint regressor, and linear views of an artefact."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_schemas.clips import ClipRow
from data_schemas.errors import InputError
from data_schemas.mesh import MeshReader
from data_schemas.skinned_body import Body
from stages.shared.meshes.graph import edges_of
from stages.shared.meshes.joint_regressor import fit_joint_regressor
from stages.shared.meshes.linear_views import LinearView
from stages.shared.meshes.measures import averaged_until, box_diagonal, melv_mm, mpjpe_mm, rmse_share
from stages.shared.meshes.windows import WindowList
from tests.shared.meshes.figures import write_arms
from tests.shared.meshes.shapes import arm, ball, grid


def test_melv_is_blind_to_rigid_movement_and_counts_scale() -> None:
    vertices, faces = ball(60)
    edges, _ = edges_of(faces)
    moved = Rotation.from_rotvec((0.3, 1, 2)).apply(vertices) + np.array([5, 0, 1])
    mean = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1).mean()
    found = melv_mm(np.stack([moved, 1.1 * vertices, 0.9 * vertices]), vertices, edges)
    assert found[0] < 1e-3 and np.allclose(found[1:], 100 * mean, rtol=1e-4)


def test_melv_by_hand() -> None:
    still = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0]], float)
    moved = np.array([[0, 0, 0], [1.3, 0, 0], [0, 1.9, 0]], float)
    assert melv_mm(moved[None], still, np.array([[0, 1], [0, 2]]))[0] == pytest.approx(200)


def test_errors_by_hand() -> None:
    true = np.zeros((2, 4, 3))
    true[:, 1:] = np.array([[3, 0, 0], [0, 4, 0], [3, 4, 0]])
    assert np.allclose(box_diagonal(true), 5)
    assert np.allclose(rmse_share(true + np.array([0.5, 0.5, 0.5]), true), 0.1)
    assert np.allclose(mpjpe_mm(true + np.array([0.003, 0.004, 0]), true), 5)
    assert np.allclose(averaged_until(np.array([1.0, 3.0, 5.0])), [1, 2, 3])


def test_edges_are_each_once() -> None:
    _, faces = grid(4, 5)
    edges, counts = edges_of(faces)
    assert len(np.unique(edges, axis=0)) == len(edges) == 4 * 4 + 3 * 5 + 3 * 4 and set(counts.tolist()) == {1, 2}


def test_the_regressor_is_exact_on_the_identities_it_was_fitted_to() -> None:
    topology, body = arm()
    wide = Body(body.vertices * np.array([1.3, 1.0, 0.8], np.float32), body.heads)
    long = Body(body.vertices * np.array([1.0, 1.2, 1.0], np.float32), body.heads * (1, 1.2, 1))
    found = fit_joint_regressor(topology.skin, [body, wide, long], [0, 1])
    matrix = found.matrix(topology.count)
    assert np.allclose(matrix.sum(axis=1), 1, atol=1e-4) and found.names == ("lower", "upper")
    for each in (body, wide, long):
        assert np.abs(matrix[1] @ each.vertices - each.heads[1]).max() < 1e-3


def test_views_of_bones_and_of_vertices_agree(tmp_path: Path) -> None:
    with (
        MeshReader(write_arms(tmp_path / "m", clips=1)) as dense,
        MeshReader(write_arms(tmp_path / "n", clips=2)) as both,
    ):
        mapping = np.random.default_rng(0).normal(size=(6, dense.topology.count)).astype(np.float32)
        one, other = (LinearView(reader, mapping).window("arm-0", 3, 30) for reader in (dense, both))
        assert not dense.is_skinned("arm-0") and both.is_skinned("arm-0")
        assert one.shape == (27, 6, 3) and np.abs(one - other).max() < 1e-4 * np.abs(one).max()


def test_windows_are_listed_once_each_and_short_clips_left_out() -> None:
    rows = [
        ClipRow(name, name, "", "", frames, 25.0, 1.0, "train", "")
        for name, frames in (("a", 20), ("b", 9), ("c", 13))
    ]
    listed = WindowList(rows, 10, 3)
    found = [(listed[i].clip, listed[i].start, listed[i].stop) for i in range(len(listed))]
    assert found == [("a", 0, 10), ("a", 3, 13), ("a", 6, 16), ("a", 9, 19), ("c", 0, 10), ("c", 3, 13)]
    assert listed.short == 1 and [each.clip for each in listed.spread(2)] == ["a", "c"]
    with pytest.raises(InputError, match="No clip has the 30 frames of a window; the longest has 20"):
        WindowList(rows, 30, 1)
