"""The reader on real recordings, where they are at hand: every archive, a few files of each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stages.ingest.config import Config
from stages.ingest.run import run
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of, values_of
from stages.shared.formats.bvh_write import write_bvh
from stages.shared.formats.sources import find_sources
from stages.shared.kinematics.forward import positions_of

DATA = Path(__file__).parents[2] / ".." / "shared" / "data"
ARCHIVES = ("bandai-namco-1.zip", "bandai-namco-2.zip", "cmu-dance.zip", "lafan1-g1.zip")
EXPECTED = {  # pelvis, unit, joints, bones that carry points, joints with tracks
    "bandai-namco-1.zip": ("Hips", 0.01, 22, 21, ["Hips"]),
    "bandai-namco-2.zip": ("Hips", 0.01, 22, 21, ["Hips"]),
    "cmu-dance.zip": ("hip", 0.01, 43, 21, []),
    "lafan1-g1.zip": ("pelvis", 1.0, 31, 29, []),
}
pytestmark = [pytest.mark.real, pytest.mark.skipif(not DATA.is_dir(), reason="no recordings at hand")]


def _some(archive: str, count: int) -> list:
    found = find_sources([str(DATA / archive)])
    return [found[i] for i in np.linspace(0, len(found) - 1, count).astype(int)]


@pytest.mark.parametrize("archive", ARCHIVES)
def test_rigs_are_understood(archive: str) -> None:
    pelvis, unit, joints, seen, tracks = EXPECTED[archive]
    for source in _some(archive, 3):
        bvh = read_bvh(source.read(), source.name)
        skeleton, motion, _ = motion_of(bvh, trim_first="auto")
        assert (skeleton.names[skeleton.root], skeleton.unit_m, skeleton.joints) == (pelvis, unit, joints)
        assert skeleton.up_axis == "y" and skeleton.sampled.sum() == seen
        assert [skeleton.names[joint] for joint in motion.track_joints] == tracks
        counts = np.bincount(skeleton.groups[skeleton.sampled], minlength=5)
        assert counts[1] == counts[2] and counts[3] == counts[4] and (counts > 0).all()
        heads = positions_of(skeleton, motion)[:, skeleton.sampled]
        assert 0.3 < np.ptp(heads[..., 1], axis=1).max() < 2.0  # metres from feet to head, hands up or not


@pytest.mark.parametrize("archive", ARCHIVES)
def test_files_come_back(archive: str) -> None:
    source = _some(archive, 2)[1]
    data = source.read()
    bvh = read_bvh(data, source.name)
    skeleton, motion, _ = motion_of(bvh)
    rows = values_of(bvh, skeleton, motion, bvh.values)
    again = read_bvh(write_bvh(bvh, rows), "again")
    other = motion_of(again)[1]
    assert np.abs(positions_of(skeleton, other) - positions_of(skeleton, motion)).max() < 1e-4
    keys = {frame: frame for frame in range(bvh.frames)}
    assert write_bvh(bvh, rows, keys).rstrip() == data.rstrip()


@pytest.mark.parametrize("archive", ARCHIVES)
def test_positions_agree_with_pymotion(archive: str, tmp_path: Path) -> None:
    pytest.importorskip("pymotion")
    from pymotion.io.bvh import BVH
    from pymotion.ops.skeleton import fk

    source = min(_some(archive, 5), key=lambda source: source.size)
    path = tmp_path / "clip.bvh"
    path.write_bytes(source.read().rstrip() + b"\n")
    bvh = read_bvh(path.read_bytes(), "clip")
    skeleton, motion, _ = motion_of(bvh)
    reader = BVH()
    reader.load(str(path))
    rotations, places, parents, offsets, *_ = reader.get_data()
    for joint in motion.track_joints:  # that library keeps places below the root apart from its kinematics
        assert (parents[joint], np.ptp(rotations[:, 0], axis=0).max()) == (0, 0)
    moved = np.zeros_like(places[:, 0]) if len(motion.track_joints) else places[:, 0]
    positions, _ = fk(rotations, moved, offsets, parents)
    ours = positions_of(skeleton, motion).astype(np.float64)
    below = ours - ours[:, [skeleton.root]]
    theirs = (positions - positions[:, [skeleton.root]]) * skeleton.unit_m
    body = skeleton.groups >= 0
    assert np.allclose(below[:, body], theirs[:, body], atol=1e-4)


def test_salsa_runs_at_its_true_rate_and_without_its_calibration_pose(tmp_path: Path) -> None:
    from data_schemas.motion import MotionReader

    wanted = tuple(f"{DATA / 'cmu-dance.zip'}!cmu-dance/{name}.bvh" for name in ("salsa/05", "indian/04"))
    report = run(Config(sources=wanted, output=tmp_path / "motion", fps_override=("*salsa*=60",)))
    assert report.figures["files"] == {"repaired": 2}
    with MotionReader(tmp_path / "motion") as reader:
        rows = {row.clip: row for row in reader.clips}
        assert rows["cmu-dance.salsa.05"].fps == 60 and rows["cmu-dance.indian.04"].fps == 120
        assert rows["cmu-dance.salsa.05"].split == "test" and rows["cmu-dance.indian.04"].split == "train"
        for row in reader.clips:
            heads = positions_of(reader.skeleton(row.skeleton), reader.motion(row.clip, 0, 10))
            assert np.linalg.norm(np.diff(heads, axis=0), axis=-1).max() < 0.1
