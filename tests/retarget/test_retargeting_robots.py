"""A motion on a robot: hands and feet near, joints about their axes alone, limits on request, and the way back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stages.shared.clips
from data_schemas.errors import UsageError
from stages.retarget.config import Config
from stages.retarget.run import run
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of, read_bvh_motion
from stages.shared.formats.recording import Asked
from stages.shared.formats.robot_csv import read_robot_csv
from stages.shared.formats.robot_rig import robot_rig
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.formats.robot_files import RobotText

WALK = Path(stages.shared.clips.__file__).parent / "walk.bvh"


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    (tmp_path / "robot.urdf").write_bytes(RobotText().urdf())
    return tmp_path / "robot.urdf"


def test_a_walk_becomes_angles_whose_limbs_end_where_free_joints_put_them(urdf: Path, tmp_path: Path) -> None:
    free, angles = tmp_path / "free.bvh", tmp_path / "angles.csv"
    run(Config(input=WALK, to=urdf, output=free, device="cpu"))
    report = run(Config(input=WALK, to=urdf, output=angles, device="cpu"))
    assert "turn about other axes" in " ".join(report.lines)
    (bvh,) = read_bvh_motion(free.read_bytes(), "free.bvh", Asked())
    asked = Asked(rig=urdf.read_bytes(), rig_name="robot.urdf", fps_override=bvh.motion.fps)
    (robot,) = read_robot_csv(angles.read_bytes(), "angles.csv", asked)
    feet = [robot.skeleton.names.index(f"{side}_ankle") for side in ("left", "right")]
    apart = positions_of(robot.skeleton, robot.motion) - positions_of(bvh.skeleton, bvh.motion)
    assert np.linalg.norm(apart, axis=-1)[:, feet].mean() < 0.015  # its trunk and arms can do little
    steps = np.abs(np.diff(np.loadtxt(angles, delimiter=",")[:, 7:], axis=0))
    assert steps.max() < np.radians(30)


def test_limits_are_kept_on_request(urdf: Path, tmp_path: Path) -> None:
    urdf.write_bytes(RobotText(limits=(-0.5, 0.4)).urdf())
    report = run(Config(input=WALK, to=urdf, output=tmp_path / "a.csv", respect_limits=True, device="cpu"))
    assert "held at a limit" in " ".join(report.lines)
    hinges = robot_rig(urdf.read_bytes(), "robot.urdf").hinges
    assert not hinges.beyond(np.loadtxt(tmp_path / "a.csv", delimiter=",")[:, 7:]).any()


def test_a_robots_motion_goes_on_a_human_rig(urdf: Path, tmp_path: Path) -> None:
    run(Config(input=WALK, to=urdf, output=tmp_path / "a.csv", device="cpu"))
    back = Config(input=tmp_path / "a.csv", skeleton=str(urdf), to=WALK, output=tmp_path / "b.bvh", device="cpu")
    run(back)
    skeleton, motion, _ = motion_of(read_bvh((tmp_path / "b.bvh").read_bytes(), "b.bvh"))
    assert motion.frames == read_bvh(WALK.read_bytes(), "w").frames and skeleton.joints == 13


def test_what_a_robot_cannot_give_is_refused(urdf: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"suffix \.fbx.*Name a file of \.bvh, \.glb"):
        run(Config(input=WALK, to=urdf, output=tmp_path / "a.fbx", device="cpu"))
    with pytest.raises(UsageError, match="--respect-limits"):
        run(Config(input=WALK, to=WALK, output=tmp_path / "a.bvh", respect_limits=True, device="cpu"))
    with pytest.raises(UsageError, match="--respect-limits"):
        run(Config(input=WALK, to=urdf, output=tmp_path / "a.bvh", respect_limits=True, device="cpu"))
