"""Real recordings out and back: BVH through upc-pymotion, GLB through its raw numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stages.export.config import Config
from stages.export.run import run
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.sources import find_sources, source_named
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.formats.glb_reading import read_glb

DATA = Path(__file__).parents[2] / ".." / "shared" / "data"
ARCHIVES = ("bandai-namco-1.zip", "cmu-dance.zip", "lafan1-g1.zip")
pytestmark = [pytest.mark.real, pytest.mark.skipif(not DATA.is_dir(), reason="no recordings at hand")]


@pytest.mark.parametrize("archive", ARCHIVES)
def test_joints_stay_where_they_are(archive: str, tmp_path: Path) -> None:
    source = min(find_sources([str(DATA / archive)]), key=lambda source: source.size)
    skeleton, motion, _ = motion_of(read_bvh(source_named(source.name).read(), source.member))
    places = positions_of(skeleton, motion)
    for suffix in ("glb", "bvh"):
        run(Config(input=source.name, output=tmp_path / f"clip.{suffix}"))
    found = read_glb((tmp_path / "clip.glb").read_bytes()).world()[1][:, : skeleton.joints]
    assert np.abs(found - places).max() < 1e-4
    again, moved, _ = motion_of(read_bvh((tmp_path / "clip.bvh").read_bytes(), "clip"))
    assert np.abs(positions_of(again, moved) - places).max() < 1e-4
    pytest.importorskip("pymotion")
    from pymotion.io.bvh import BVH
    from pymotion.ops.skeleton import fk

    reader = BVH()
    path = tmp_path / "clip.bvh"
    path.write_bytes(path.read_bytes().rstrip() + b"\n")
    reader.load(str(path))
    rotations, positions, parents, offsets, *_ = reader.get_data()
    # That library keeps places below the root apart from its kinematics: compare below the pelvis.
    theirs, _ = fk(rotations, np.zeros_like(positions[:, 0]), offsets, parents)
    theirs = (theirs - theirs[:, [skeleton.root]]) * skeleton.unit_m
    body = skeleton.groups >= 0
    assert np.abs(theirs[:, body] - (places - places[:, [skeleton.root]])[:, body]).max() < 1e-4
