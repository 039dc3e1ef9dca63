"""A real robot's joint angles: joints where the BVH of the same recordings has them, and every clip of an archive."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_schemas.artefact import open_artefact
from data_schemas.motion import MotionReader, skeleton_id
from data_schemas.source_table import read_sources
from stages.export.config import Config as ExportConfig
from stages.export.run import run as export
from stages.ingest.config import Config
from stages.ingest.run import run
from stages.retarget.config import Config as RetargetConfig
from stages.retarget.run import run as retarget
from stages.shared.formats.readers import read_recordings, recognise
from stages.shared.formats.recording import Asked, Recording
from stages.shared.formats.robot_rig import robot_named
from stages.shared.formats.sources import source_named
from stages.shared.kinematics.forward_numpy import positions_of

CLIPS = Path(__file__).parents[2] / "stages" / "shared" / "clips"
DATA = Path(__file__).parents[2] / ".." / "shared" / "data"
BOTH, ANGLES = DATA / "lafan1-g1.zip", DATA / "g1-moves.zip"
URDF = f"{BOTH}!lafan1-g1/g1_29dof.urdf"
pytestmark = [
    pytest.mark.real,
    pytest.mark.skipif(not (BOTH.is_file() and ANGLES.is_file()), reason="no recordings at hand"),
]


def _read(member: str) -> Recording:
    source = source_named(f"{BOTH}!lafan1-g1/{member}")
    data = source.read()
    chosen = recognise(data, source.name)
    assert chosen is not None
    (recording,) = read_recordings(data, source, chosen, Asked())  # the URDF is found one folder up
    return recording


@pytest.mark.parametrize("name", ["walk1_subject1", "dance1_subject2", "fallAndGetUp1_subject1"])
def test_angles_and_bvh_are_one_motion_on_one_rig(name: str) -> None:
    angles, bvh = _read(f"csv/{name}.csv"), _read(f"{name}.bvh")
    assert skeleton_id(angles.skeleton) == skeleton_id(bvh.skeleton)
    apart = positions_of(angles.skeleton, angles.motion) - positions_of(bvh.skeleton, bvh.motion)
    assert np.linalg.norm(apart, axis=-1).max() < 1e-4  # the BVH's places are rounded to 0.1 mm
    alike = np.abs((angles.motion.rotations * bvh.motion.rotations).sum(-1))
    assert np.rad2deg(2 * np.arccos(np.clip(alike.astype(float), 0, 1))).max() < 0.06
    assert angles.motion.fps == bvh.motion.fps == 30


@pytest.mark.parametrize("member", ["csv/dance1_subject2.csv", "dance1_subject2.bvh"])
def test_the_published_angles_come_back(member: str, tmp_path: Path) -> None:
    export(ExportConfig(input=f"{BOTH}!lafan1-g1/{member}", output=tmp_path / "o.csv", format="robot-csv", rig=URDF))
    published = source_named(f"{BOTH}!lafan1-g1/csv/dance1_subject2.csv").read()
    wanted, made = (
        np.loadtxt(text.decode().splitlines(), delimiter=",")
        for text in (published, (tmp_path / "o.csv").read_bytes())
    )
    assert np.abs(wanted - made).max() < (2e-6 if member.endswith("csv") else 6e-5)  # a BVH's places are rounded


def test_a_persons_dance_on_the_robot(tmp_path: Path) -> None:
    config = RetargetConfig(
        input=CLIPS / "dance_a.bvh", to=Path(URDF), output=tmp_path / "o.csv", respect_limits=True, device="cpu"
    )
    retarget(config)
    robot = robot_named(URDF)
    angles = np.loadtxt(tmp_path / "o.csv", delimiter=",")[:, 7:]
    assert not robot.hinges.beyond(angles).any()
    assert np.quantile(np.abs(np.diff(angles, axis=0)), 0.99) < np.radians(45)


def test_every_clip_of_an_archive_without_its_urdf(tmp_path: Path) -> None:
    config = Config(sources=(str(ANGLES),), output=tmp_path / "out", skeleton=URDF, fps_override=("*=60",), workers=1)
    run(config)
    table = read_sources(open_artefact(tmp_path / "out").folder)
    assert {(row.format, row.outcome) for row in table} == {("robot", "kept")} and len(table) == 59
    with MotionReader(tmp_path / "out") as reader:
        assert len(reader.skeletons()) == 1 and sum(row.frames for row in reader.clips) == 106_149
        for row in reader.clips:
            assert row.fps == 60 and "CC BY 4.0" in row.licence
            assert row.quality.flips == 0 and not row.quality.swapped
            assert row.quality.floor_penetration is not None and row.quality.floor_penetration < 0.05
