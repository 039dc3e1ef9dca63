"""Joint positions agree with two independent readers to 0.1 mm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of, values_of
from stages.shared.formats.bvh_write import write_bvh
from stages.shared.kinematics.forward import positions_of
from tests.shared.formats.bvh_texts import BvhText

CASES = {
    "plain": BvhText(frames=6),
    "other-orders": BvhText(frames=6, orders={"Hips": ("Xrotation", "Yrotation", "Zrotation")}),
    "tabs-crlf": BvhText(frames=6, newline="\r\n", indent="\t"),
}


def _ours(path: Path) -> np.ndarray:
    skeleton, motion, _ = motion_of(read_bvh(path.read_bytes(), path.name))
    return positions_of(skeleton, motion)


def _rewritten(path: Path, folder: Path) -> Path:
    """The file once more, every row from our own motion, on a path of its own."""
    bvh = read_bvh(path.read_bytes(), path.name)
    skeleton, motion, _ = motion_of(bvh)
    target = folder / "again.bvh"
    target.write_bytes(write_bvh(bvh, values_of(bvh, skeleton, motion)))
    return target


@pytest.fixture(params=[*CASES, "embedded-clip"])
def clip(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    if request.param == "embedded-clip":
        return Path(__file__).parents[3] / "stages" / "shared" / "clips" / "kick.bvh"
    path = tmp_path / "clip.bvh"
    path.write_bytes(CASES[request.param].data())
    return path


@pytest.mark.parametrize("rewritten", [False, True], ids=["as-found", "written-by-us"])
def test_with_pymotion(clip: Path, tmp_path: Path, rewritten: bool) -> None:
    pytest.importorskip("pymotion")
    from pymotion.io.bvh import BVH
    from pymotion.ops.skeleton import fk

    reader = BVH()
    reader.load(str(_rewritten(clip, tmp_path) if rewritten else clip))
    rotations, places, parents, offsets, *_ = reader.get_data()
    positions, _ = fk(rotations, places[:, 0], offsets, parents)
    assert np.allclose(_ours(clip), positions * 0.01, atol=1e-4)


@pytest.mark.parametrize("rewritten", [False, True], ids=["as-found", "written-by-us"])
def test_with_bvhio(clip: Path, tmp_path: Path, rewritten: bool) -> None:
    bvhio = pytest.importorskip("bvhio")
    root = bvhio.readAsHierarchy(str(_rewritten(clip, tmp_path) if rewritten else clip))
    ours = _ours(clip)
    for frame in (0, 3, 5):
        root.loadPose(frame)
        joints = [joint for joint, _, _ in root.layout()]
        names = [joint.name for joint in read_bvh(clip.read_bytes(), "a").joints]
        theirs = {joint.Name: np.array(joint.PositionWorld) for joint in joints}
        assert np.allclose(ours[frame], [theirs[name] * 0.01 for name in names], atol=1e-4)
