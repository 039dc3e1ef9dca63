"""Cloth: the sheet, its contacts, and what a simulation must satisfy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_schemas.mesh import MeshReader
from stages.shared.meshes.graph import edges_of, graph_of
from stages.shared.meshes.measures import edge_lengths
from stages.simulate_cloth.checks import check_frames
from stages.simulate_cloth.collisions import near_pairs, near_pairs_plain
from stages.simulate_cloth.config import Config
from stages.simulate_cloth.run import run
from stages.simulate_cloth.sheet import coloured, make_sheet, opposite_pairs
from stages.simulate_cloth.xpbd import GRAVITY, ClothSolver, Settings, pins_of


def test_the_sheet_is_flat_whole_and_has_no_symmetry() -> None:
    sheet = make_sheet()
    assert len(sheet.vertices) == 484 and np.ptp(sheet.vertices[:, 1]) == 0
    graph = graph_of(sheet.faces, 484)
    assert graph.pieces == 1 and graph.crowded == 0 and len(graph.edges) == len(sheet.edges)
    assert sheet.masses.sum() == pytest.approx(0.2 * sheet.area)
    centred = sheet.vertices - sheet.vertices.mean(axis=0)
    for mirrored in (centred * (-1, 1, 1), centred * (1, 1, -1), centred * (-1, 1, -1)):
        nearest = np.linalg.norm(mirrored[:, None] - centred[None], axis=-1).min(axis=1)
        assert nearest.max() > 0.03


def test_threads_run_along_rows_and_columns() -> None:
    sheet = make_sheet(6)
    first, second = sheet.edges[: sheet.threads].T
    row, column = abs(first // 6 - second // 6), abs(first % 6 - second % 6)
    assert ((row + column) == 1).all() and sheet.threads == 60
    assert len(sheet.bends) == len(sheet.edges) - 20  # each inner edge has two opposite vertices


def test_opposite_pairs_are_those_of_a_plain_search() -> None:
    faces = make_sheet(5).faces
    found = {tuple(sorted(pair)) for pair in opposite_pairs(faces).tolist()}
    plain = set()
    for edge in edges_of(faces)[0]:
        beside = [face for face in faces.tolist() if set(edge.tolist()) <= set(face)]
        if len(beside) == 2:
            plain.add(tuple(sorted(next(iter(set(face) - set(edge.tolist()))) for face in beside)))
    assert found == plain


@settings(max_examples=30, deadline=None)
@given(st.integers(2, 30), st.integers(1, 3), st.floats(0.05, 1.0), st.integers(0, 1000))
def test_hashed_pairs_are_those_of_comparing_all(count: int, sims: int, reach: float, seed: int) -> None:
    places = np.random.default_rng(seed).uniform(-1, 1, (sims, count, 3))
    found = list(zip(*(part.tolist() for part in near_pairs(places, reach)), strict=True))
    assert len(set(found)) == len(found) and set(found) == near_pairs_plain(places, reach)


def test_no_vertex_occurs_twice_in_a_colour() -> None:
    pairs = make_sheet(8).edges
    groups = coloured(pairs)
    assert sorted(np.concatenate(groups).tolist()) == list(range(len(pairs)))
    assert all(len(np.unique(pairs[group])) == 2 * len(group) for group in groups)


def test_free_cloth_falls_as_gravity_says() -> None:
    sheet = make_sheet(6, size_m=0.3)
    solver = ClothSolver(sheet, np.array([[0, 35]]), Settings(1 / 1000, thickness_m=0.01))
    solver._inverse[:] = (1 / sheet.masses)[:, None]  # nothing is pinned
    solver._tethers[:] = 1e9
    list(solver.frames(6, 25.0))
    seconds, drag = 5 / 25, 0.4
    fallen = GRAVITY / drag * (seconds - (1 - np.exp(-drag * seconds)) / drag)
    assert -solver.places[:, 1].mean() == pytest.approx(fallen, rel=0.02)
    assert np.abs(edge_lengths(solver.places[:, :, 0], sheet.edges) / sheet.lengths - 1).max() < 1e-6


def _simulated(steps: int, frames: int = 14) -> tuple[np.ndarray, np.ndarray, object, np.ndarray]:
    sheet = make_sheet(8, size_m=0.32)
    pins = pins_of(sheet, 3, 1)
    solver = ClothSolver(sheet, pins, Settings(1 / steps, thickness_m=0.015))
    places, energies = [], []
    for frame in solver.frames(frames, 25.0):
        places.append(frame)
        energies.append(solver.energy())
    return np.stack(places, axis=1), np.stack(energies), sheet, pins


def test_pins_stay_threads_keep_their_length_vertices_keep_apart_and_energy_falls() -> None:
    places, energies, sheet, pins = _simulated(2000)
    found = check_frames(places, sheet, pins, 0.015)
    assert found.pin_drift_m == 0
    assert found.strain < 0.02
    assert found.nearest_m >= 0.015
    fallen = energies[0] - energies.min(axis=0)
    assert (fallen > 0).all() and (np.diff(energies, axis=0) < 0.02 * fallen).all()
    assert (places[:, -1, :, 1].min(axis=1) < -0.05).all()  # it hangs


def test_smaller_steps_stretch_less_and_come_nearer_to_the_finest() -> None:
    finest = _simulated(2000, 5)[0]
    coarse, fine = (_simulated(steps, 5) for steps in (250, 1000))
    strains = [check_frames(each[0], each[2], each[3], 0.015).strain_99 for each in (coarse, fine)]
    errors = [np.abs(each[0][:, -1] - finest[:, -1]).mean() for each in (coarse, fine)]
    assert strains[1] < strains[0] and errors[1] < errors[0] and errors[1] < 0.01


def test_the_stage_writes_meshes_of_one_connectivity_and_the_same_again(tmp_path: Path) -> None:
    config = Config(output=tmp_path / "a", count=3, seconds=0.12, rows=6, size_m=0.3, batch=2)
    report = run(config)
    run(config.model_copy(update={"output": tmp_path / "b"}))
    assert report.figures["simulations"] == 3 and report.figures["strain"] < 0.02
    with MeshReader(tmp_path / "a") as one, MeshReader(tmp_path / "b") as other:
        assert one.artefact.manifest.digest == other.artefact.manifest.digest
        assert [row.frames for row in one.clips] == [3, 3, 3] and one.topology.count == 36
        assert not np.array_equal(one.vertices("cloth-000000"), one.vertices("cloth-000001"))


def test_a_sheet_that_would_touch_itself_at_rest_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="would touch itself at rest"):
        Config(output=tmp_path / "a", rows=60)


def test_a_simulation_has_at_least_one_frame(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="at least one frame"):
        Config(count=1, seconds=0.01, output=tmp_path / "cloth")
