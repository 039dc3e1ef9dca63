"""What the quality of a recording is told by: each fault, put into a sound clip, is found; nothing else is."""

from __future__ import annotations

import itertools
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import stages.shared.clips
from data_schemas.quality import MotionQuality
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.humanoid import motion_quality
from stages.shared.humanoid.motion_quality import (
    FLIP_RAD,
    HUMAN_RAD_PER_S,
    LEAST_S,
    STILL_MPS,
    _fast_turns,
    _still,
)
from stages.shared.humanoid.retargeting import rest_pose
from stages.shared.kinematics.forward import positions_of
from stages.shared.kinematics.forward_numpy import BLOCK_FRAMES
from stages.shared.kinematics.playback_speed import speed_features, speed_of

CLIPS = Path(stages.shared.clips.__file__).parent


def measure_quality(skeleton: Skeleton, motion: Motion) -> MotionQuality:
    return motion_quality.measure_quality(skeleton, motion, positions_of(skeleton, motion))


@pytest.fixture(scope="module")
def walk() -> tuple[Skeleton, Motion]:
    return motion_of(read_bvh((CLIPS / "walk.bvh").read_bytes(), "walk"))[:2]


def test_a_sound_clip_has_no_fault(walk):
    found = measure_quality(*walk)
    assert (found.still_share, found.repeated_share, found.spikes, found.flips) == (0, 0, 0, 0)
    assert not (found.t_pose or found.wrong_rate or found.swapped)
    assert found.foot_skate is not None and found.foot_skate < 0.3
    assert found.floor_penetration is not None and found.floor_penetration < 0.05


def test_where_it_looks_and_stands_means_nothing(walk):
    skeleton, motion = walk
    yaw = Rotation.from_euler("y", 130, degrees=True)
    rotations = (yaw * Rotation.from_quat(motion.rotations.reshape(-1, 4))).as_quat().reshape(motion.rotations.shape)
    roots = yaw.apply(motion.root_positions) + np.array([5.0, 0.0, -3.0])
    moved = replace(motion, rotations=rotations.astype(np.float32), root_positions=roots.astype(np.float32))
    ours, theirs = asdict(measure_quality(skeleton, motion)), asdict(measure_quality(skeleton, moved))
    for name, value in ours.items():
        assert theirs[name] == pytest.approx(value, rel=0.02, abs=2e-3), name


def test_repeated_frames_are_counted(walk):
    skeleton, motion = walk
    twice = np.repeat(np.arange(motion.frames), 2)
    found = measure_quality(skeleton, replace(motion, rotations=motion.rotations[twice],
                                              root_positions=motion.root_positions[twice]))  # fmt: skip
    assert found.repeated_share == pytest.approx(0.5, abs=0.01)


def test_a_held_pose_is_still_and_no_t_pose(walk):
    skeleton, motion = walk
    rows = np.concatenate([np.arange(30), np.full(30, 30)])
    held = replace(motion, rotations=motion.rotations[rows], root_positions=motion.root_positions[rows])
    found = measure_quality(skeleton, held)
    assert found.still_share == pytest.approx(0.5, abs=0.05)
    assert not found.t_pose


def test_a_t_pose_is_found(walk):
    skeleton, _ = walk
    rest = rest_pose(skeleton)  # its arms hang, and it looks along X
    rotations = rest.rotations.copy()
    for side, degrees in (("left", 90), ("right", -90)):
        arm = [skeleton.names.index(f"{side}_{joint}") for joint in ("shoulder", "elbow")]
        rotations[0, arm] = Rotation.from_euler("x", degrees, degrees=True).as_quat()
    held = Motion(np.repeat(rotations, 40, axis=0), np.repeat(rest.root_positions, 40, axis=0), 30.0)
    assert measure_quality(skeleton, held).t_pose
    hanging = Motion(np.repeat(rest.rotations, 40, axis=0), held.root_positions, 30.0)
    assert not measure_quality(skeleton, hanging).t_pose


def test_flips_and_spikes_are_counted(walk):
    skeleton, motion = walk
    rotations = motion.rotations.copy()
    elbow = skeleton.names.index("left_elbow")
    over = Rotation.from_rotvec([0, np.pi, 0])
    rotations[20, elbow] = (Rotation.from_quat(rotations[20, elbow]) * over).as_quat()
    rotations[40, elbow] = (Rotation.from_quat(rotations[40, elbow]) * Rotation.from_rotvec([0, 1.7, 0])).as_quat()
    found = measure_quality(skeleton, replace(motion, rotations=rotations))
    assert (found.flips, found.spikes) == (2, 4)  # into the frame and out of it


def test_exchanged_sides_are_found(walk):
    skeleton, motion = walk
    exchanged = replace(skeleton, groups=np.array([0, 2, 1, 4, 3], np.int8)[skeleton.groups])
    assert measure_quality(exchanged, motion).swapped


def test_sliding_and_sinking_feet_are_measured(walk):
    skeleton, motion = walk
    before = measure_quality(skeleton, motion)
    roots = motion.root_positions.copy()
    roots[:, 0] += np.linspace(0, 0.2 * motion.frames / motion.fps, motion.frames)
    slid = measure_quality(skeleton, replace(motion, root_positions=roots))
    assert slid.foot_skate > before.foot_skate + 0.05
    roots = motion.root_positions.copy()
    roots[10:14, 1] -= 0.12
    sunk = measure_quality(skeleton, replace(motion, root_positions=roots))
    assert sunk.floor_penetration > before.floor_penetration + 0.05


@pytest.mark.parametrize("name", ["walk", "run", "dance_a", "crawl", "spin"])
def test_the_faster_a_clip_is_played_the_faster_it_seems(name: str):
    skeleton, motion, _ = motion_of(read_bvh((CLIPS / f"{name}.bvh").read_bytes(), name))
    positions = positions_of(skeleton, motion)
    found = [speed_features(skeleton, positions, motion.fps * factor) for factor in (0.5, 1, 2)]
    seems = [speed_of(features) for features in found if features is not None]
    assert len(seems) == 3 and seems[0] < seems[1] < seems[2]


def test_too_little_to_see_is_said(walk):
    skeleton, motion = walk
    positions = positions_of(skeleton, motion)
    assert speed_features(skeleton, positions[:10], motion.fps) is None
    assert speed_features(skeleton, np.repeat(positions[:1], 60, axis=0), motion.fps) is None
    one = measure_quality(skeleton, replace(motion, rotations=motion.rotations[:1],
                                            root_positions=motion.root_positions[:1]))  # fmt: skip
    assert one.speed_log2 is None and not one.wrong_rate


@pytest.mark.parametrize("frames", [2, BLOCK_FRAMES, BLOCK_FRAMES + 2])
def test_spikes_flips_and_stillness_in_blocks_are_those_of_whole_arrays(frames):
    rng = np.random.default_rng(frames)
    turns = np.cumsum(rng.normal(0, 0.3, (frames, 4, 3)) * (rng.uniform(size=(frames, 4, 1)) < 0.5), axis=0)
    rotations = Rotation.from_rotvec(turns.reshape(-1, 3)).as_quat().reshape(frames, 4, 4).astype(np.float32)
    jumps = rng.uniform(size=frames) < 0.01
    positions = np.cumsum(rng.normal(0, 1.0, (frames, 4, 3)) * jumps[:, None, None], axis=0)
    body = np.array([0, 2, 3])
    for fps in (10.0, 30.0, 120.0):
        cosine = np.abs((rotations[1:, body].astype(np.float64) * rotations[:-1, body]).sum(-1))
        turned = 2 * np.arccos(np.clip(cosine, 0, 1))
        plainly = int((turned * fps > HUMAN_RAD_PER_S).any(axis=1).sum()), int((turned > FLIP_RAD).any(axis=1).sum())
        assert _fast_turns(rotations, body, fps) == plainly
        speeds = np.linalg.norm(np.diff(positions[:, body], axis=0), axis=-1).max(axis=1) * fps
        stays = np.zeros(frames, bool)
        at = 0
        for quiet, run in itertools.groupby((speeds < STILL_MPS).tolist()):
            steps = len(list(run))
            stays[at : at + steps + 1] |= quiet and steps >= LEAST_S * fps
            at += steps
        assert np.array_equal(_still(positions, body, fps), stays)
