"""Bodies with a surface: at the figure's size and place, and posed by the page as by Python."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("starlette")
pytest.importorskip("httpx2")

from data_schemas.errors import PumpsError
from data_schemas.skinned_body import Body, skinned_vertices
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.meshes.body_rig import rig_of_body
from stages.studio import surface
from tests.shared.meshes.figures import box_man
from tests.studio.bench_in_folder import CLIPS, TOKEN, Page, bench_in
from tests.studio.test_keyframes import HERE, node_program


@pytest.fixture(scope="module")
def kick() -> Any:
    return motion_of(read_bvh((CLIPS / "kick.bvh").read_bytes(), "kick.bvh"))[:2]


def of_size(size: float) -> tuple[Any, Body]:
    topology, body = box_man()
    return topology, Body((body.vertices * size).astype(np.float32), body.heads * size)


@pytest.mark.parametrize("size", [0.6, 1.0, 1.7])
def test_a_body_of_any_size_stands_where_the_figure_does(kick: Any, size: float) -> None:
    """The body has the figure's own bones, so every joint is where the figure has it."""
    skeleton, motion = kick
    topology, body, _, heads = surface.dressed(skeleton, motion, *of_size(size))
    assert topology.skin is not None and topology.skin.names == skeleton.names
    assert np.ptp(body.vertices[:, 1]) == pytest.approx(np.ptp(box_man()[1].vertices[:, 1]), rel=1e-3)
    np.testing.assert_allclose(heads, positions_of(skeleton, motion), atol=2e-3)


def test_the_page_poses_it_as_python_does(kick: Any, tmp_path: Path) -> None:
    skeleton, motion = kick
    topology, body, rotations, heads = surface.dressed(skeleton, motion, *of_size(0.8))
    (tmp_path / "packed").write_bytes(surface.packed(topology, body, rotations, heads))
    words = [node_program(), str(HERE / "body.run.mjs"), str(tmp_path / "packed"), "0", "17", "17.5", "1e9"]
    shown = json.loads(subprocess.run(words, capture_output=True, text=True, check=True, timeout=120).stdout)
    frames = np.array([0, 17, 18, motion.frames - 1])
    assert topology.skin is not None
    true = skinned_vertices(topology.skin, body, rotations[frames], heads[frames])
    posed = np.array([each["vertices"] for each in shown]).reshape(4, -1, 3)
    np.testing.assert_allclose(posed[[0, 1, 3]], true[[0, 1, 3]], atol=5e-4)
    between = np.linalg.norm(posed[2] - (true[1] + true[2]) / 2, axis=-1)
    assert between.max() < 0.2 * np.linalg.norm(true[2] - true[1], axis=-1).max()
    bones = topology.skin.bones[:, 0]
    ups = Rotation.from_quat(rotations[17][bones]).apply([0, 1, 0])
    np.testing.assert_allclose(np.array(shown[1]["normals"]).reshape(-1, 3), ups, atol=1e-3)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with bench_in(tmp_path_factory.mktemp("surface") / "folder", "kick") as bench:
        yield Page(bench)


def answer(page: Page) -> Any:
    session = page.ask("open", "POST", {"file": "kick.bvh"})
    return page.client.get(f"/{TOKEN}/api/sessions/{session['id']}/motions/m1/surface")


def test_the_server_sends_it(page: Page, kick: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surface, "_standing_body", box_man)
    given = answer(page)
    assert given.status_code == 200
    assert given.content == surface.packed(*surface.dressed(*kick, *box_man()))
    counts = np.frombuffer(given.content[:20], "<u4").tolist()
    assert counts == [8 * kick[0].joints, 1, 12 * kick[0].joints, kick[0].joints, kick[1].frames]


def test_without_the_package_the_page_is_told_what_to_install(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing() -> Any:
        raise PumpsError("Bodies need the package anny.", "pip install 'pumps[mesh]'")

    monkeypatch.setattr(surface, "_standing_body", missing)
    given = answer(page)
    assert given.status_code == 400
    assert given.json() == {"error": "Bodies need the package anny. pip install 'pumps[mesh]'"}


def test_annys_body_is_as_tall_as_a_human_figure(kick: Any) -> None:
    pytest.importorskip("anny")
    skeleton, motion = kick
    topology, body, rotations, heads = surface.dressed(skeleton, motion, *surface._standing_body())
    assert topology.skin is not None
    vertices = skinned_vertices(topology.skin, body, rotations[:1], heads[:1])[0]
    figure = positions_of(skeleton, motion)[0]
    assert 0.9 < np.ptp(vertices[:, 1]) / np.ptp(figure[:, 1]) < 1.3
    pelvis = figure[skeleton.root] - heads[0, rig_of_body(topology.skin, body).root]
    assert np.linalg.norm(pelvis) < 0.1
