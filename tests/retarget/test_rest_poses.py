"""The shared pose of two rigs: their rest poses where these are alike, whatever the frames of the motion are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import stages.shared.clips
from data_schemas.skeleton import Motion, Skeleton
from stages.retarget.config import Config
from stages.retarget.run import run
from stages.retarget.targets import read_target
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.humanoid.bone_matching import ARMS, bones_of
from stages.shared.humanoid.retargeting import REST_POSE, is_human_pose, rest_pose, retarget
from stages.shared.kinematics.forward import positions_of
from tests.shared.formats.robot_files import RobotText

CLIPS = Path(stages.shared.clips.__file__).parent


def clip(name: str) -> tuple[Skeleton, Motion]:
    skeleton, motion, _ = motion_of(read_bvh((CLIPS / name).read_bytes(), name))
    return skeleton, motion


def rested(skeleton: Skeleton, motion: Motion, turns: dict[int, Rotation]) -> tuple[Skeleton, Motion]:
    """The same motion on a rig whose rest pose has some joints turned in the world."""
    every = [turns.get(joint, Rotation.identity()) for joint in range(skeleton.joints)]
    above = [every[int(parent)] if parent >= 0 else Rotation.identity() for parent in skeleton.parents]
    offsets = np.stack([turn.apply(offset) for turn, offset in zip(above, skeleton.offsets, strict=True)])
    tails = np.stack([turn.apply(tail) for turn, tail in zip(every, skeleton.tails, strict=True)])
    rotations = [
        (Rotation.from_quat(motion.rotations[:, joint]) * turn.inv()).as_quat() for joint, turn in enumerate(every)
    ]
    turned = replace(motion, rotations=np.stack(rotations, axis=1).astype(np.float32))
    return replace(skeleton, offsets=offsets, tails=tails), turned


def with_raised_arms(skeleton: Skeleton, motion: Motion, degrees: float) -> tuple[Skeleton, Motion]:
    """The same motion on a rig whose arms are raised to the sides at rest; the clips' own rest pose has them down."""
    turns = {}
    forward = np.array([1.0, 0.0, 0.0])  # the direction that the clips' rest pose faces
    for group, sign in zip(ARMS, (-1, 1), strict=True):
        raised = Rotation.from_rotvec(np.radians(sign * degrees) * forward)
        turns |= dict.fromkeys(bones_of(skeleton, group), raised)
    return rested(skeleton, motion, turns)


def degrees_off(made: Motion, truth: Motion) -> float:
    """The largest angle between the rotations of two motions of one rig."""
    pairs = [Rotation.from_quat(each.rotations.reshape(-1, 4)) for each in (made, truth)]
    return float(np.degrees((pairs[0].inv() * pairs[1]).magnitude()).max())


@pytest.mark.parametrize("name", ["walk.bvh", "backflip.bvh", "spin.bvh"])
def test_a_motion_on_its_own_header_keeps_every_rotation(name: str, tmp_path: Path) -> None:
    own = read_bvh((CLIPS / name).read_bytes(), name)
    columns = own.values.shape[1]
    rows = f"MOTION\nFrames: 1\nFrame Time: {own.frame_time}\n{' '.join(['0'] * columns)}\n"
    (tmp_path / "rest.bvh").write_text(own.header + rows)
    out = tmp_path / "out.bvh"
    report = run(Config(input=CLIPS / name, to=tmp_path / "rest.bvh", output=out, device="cpu"))
    made, truth = (motion_of(read_bvh(path.read_bytes(), path.name))[1] for path in (out, CLIPS / name))
    assert degrees_off(made, truth) < 0.1
    assert report.figures["source_frame"] == REST_POSE
    assert "the rest pose of the motion" in " ".join(report.lines)


@pytest.mark.parametrize("name", ["walk.bvh", "backflip.bvh", "spin.bvh"])
@pytest.mark.parametrize("degrees", [30.0, 45.0, 85.0])
def test_arms_at_rest_may_be_down_at_an_angle_or_level(name: str, degrees: float) -> None:
    down, level = clip(name), with_raised_arms(*clip(name), 90.0)
    raised = with_raised_arms(*clip(name), degrees)
    for source, target in ((down, raised), (raised, down), (level, raised), (raised, level)):
        made = retarget(*source, target[0], None)
        assert degrees_off(made.motion, target[1]) < 0.1
        assert made.source_frame == REST_POSE


def test_a_rest_pose_that_is_no_human_pose_serves_its_own_rig() -> None:
    skeleton, motion = clip("walk.bvh")
    turns = dict(enumerate(Rotation.random(skeleton.joints, random_state=np.random.default_rng(3))))
    rig, moved = rested(skeleton, motion, turns)
    assert not is_human_pose(rig, rest_pose(rig))
    other_pose = clip("kick.bvh")
    _, one = rested(other_pose[0], other_pose[1].at(slice(1)), turns)
    made = retarget(rig, moved, rig, one)
    assert degrees_off(made.motion, moved) < 0.1
    larger = replace(rig, offsets=rig.offsets * 1.2, tails=rig.tails * 1.2)
    assert degrees_off(retarget(rig, moved, larger, one).motion, moved) < 0.1


def test_a_rig_that_rests_y_up_and_moves_z_up_has_a_rest_pose() -> None:
    skeleton, motion = clip("walk.bvh")
    mixed = replace(skeleton, up_axis="z")  # as AMASS has it; the motion is Y up here
    assert is_human_pose(mixed, rest_pose(mixed))
    for source, target in ((mixed, skeleton), (skeleton, mixed)):
        assert degrees_off(retarget(source, motion, target).motion, motion) < 0.1


def test_a_frame_is_chosen_where_rest_poses_differ_much() -> None:
    skeleton, motion = clip("walk.bvh")
    forward = {}
    for group in ARMS:  # both arms straight up: still a standing pose
        forward |= dict.fromkeys(bones_of(skeleton, group), Rotation.from_euler("z", 180, degrees=True))
    rig, moved = rested(skeleton, motion, forward)
    made = retarget(skeleton, motion, rig, moved)
    assert made.source_frame != REST_POSE and made.source_frame == made.target_frame
    assert degrees_off(made.motion, moved) < 0.1


def test_a_robot_moves_on_its_own_urdf_as_it_did(tmp_path: Path) -> None:
    urdf, walk, again = tmp_path / "robot.urdf", tmp_path / "walk.csv", tmp_path / "again.csv"
    urdf.write_bytes(RobotText().urdf())
    run(Config(input=CLIPS / "walk.bvh", to=urdf, output=walk, device="cpu"))
    run(Config(input=walk, skeleton=str(urdf), to=urdf, output=again, method="turns", device="cpu"))
    angles = [np.loadtxt(path, delimiter=",")[:, 7:] for path in (walk, again)]
    assert np.degrees(np.abs(angles[0] - angles[1]).max()) < 0.5


def test_a_motion_on_a_robot_and_back_keeps_its_legs(tmp_path: Path) -> None:
    (tmp_path / "robot.urdf").write_bytes(RobotText().urdf())
    skeleton, motion = with_raised_arms(*clip("walk.bvh"), 90.0)  # a T-pose, in which no frame of the walk is
    target = read_target(Config(input=CLIPS / "walk.bvh", to=tmp_path / "robot.urdf", output=tmp_path / "a.csv"))
    there = retarget(skeleton, motion, target.skeleton, target.poses)
    back = retarget(target.skeleton, there.motion, skeleton)
    feet = [bones_of(skeleton, group)[1] for group in (3, 4)]
    apart = positions_of(skeleton, back.motion)[:, feet] - positions_of(skeleton, motion)[:, feet]
    assert np.linalg.norm(apart, axis=-1).mean() < 0.08
