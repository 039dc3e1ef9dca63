"""The plain fillers: exact at keys, blind between them, right where the answer is known."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation, Slerp

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.statistics.baselines import BASELINES, PREDICTION_BASELINES, Poses

PARENTS = np.array([-1, 0, 1, 1], np.int32)


def skeleton() -> Skeleton:
    offsets = np.array([[0, 0, 0], [0, 0.5, 0], [0, 0.4, 0.1], [0.2, 0.1, 0]])
    return Skeleton(
        names=("hips", "spine", "head", "arm"),
        parents=PARENTS,
        offsets=offsets,
        tails=np.full((4, 3), 0.1),
        groups=np.array([0, 0, 0, 1], np.int8),
        sampled=np.ones(4, bool),
        root=0,
    )


def motion(seed: int, frames: int = 31) -> Motion:
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 1, frames)[:, None, None]
    rotvecs = 1.2 * np.sin(rng.uniform(2, 7, (1, 4, 3)) * t + rng.uniform(0, 6, (1, 4, 3)))
    rotations = Rotation.from_rotvec(rotvecs.reshape(-1, 3)).as_quat().reshape(frames, 4, 4)
    roots = np.cumsum(rng.normal(0, 0.02, (frames, 3)), axis=0)
    tracks = np.tile([0.0, 0.5, 0], (frames, 1, 1)) + 0.1 * np.sin(5 * t)
    return Motion(
        rotations.astype(np.float32),
        roots.astype(np.float32),
        30.0,
        np.array([1], np.int32),
        tracks.astype(np.float32),
    )


KNOWN = np.zeros(31, bool)
KNOWN[[0, 10, 20, 30]] = True
PREDICTED = np.arange(31) < 21


@pytest.mark.parametrize("name", list(BASELINES))
def test_keys_are_exact_and_rows_between_are_not_read(name: str) -> None:
    poses = Poses.of(skeleton(), [motion(1), motion(2)])
    positions, rotations = BASELINES[name](poses, KNOWN)
    np.testing.assert_allclose(positions[:, KNOWN], poses.positions[:, KNOWN], atol=2e-6)
    agree = np.abs((rotations * poses.rotations.numpy()).sum(-1))[:, KNOWN]
    np.testing.assert_allclose(agree, 1, atol=1e-5)
    junk = Poses.of(skeleton(), [_junk(motion(1), KNOWN), _junk(motion(2), KNOWN)])
    again = BASELINES[name](junk, KNOWN)
    np.testing.assert_array_equal(positions, again[0])
    np.testing.assert_array_equal(rotations, again[1])


@pytest.mark.parametrize("name", list(PREDICTION_BASELINES))
def test_prediction_reads_known_frames_alone(name: str) -> None:
    poses, junk = (Poses.of(skeleton(), [m]) for m in (motion(1), _junk(motion(1), PREDICTED)))
    ours, blind = (PREDICTION_BASELINES[name](p, PREDICTED) for p in (poses, junk))
    np.testing.assert_array_equal(ours[0], blind[0])
    np.testing.assert_allclose(ours[0][:, :21], poses.positions[:, :21], atol=2e-6)


def test_windows_in_a_batch_do_not_touch_each_other() -> None:
    together = BASELINES["slerp"](Poses.of(skeleton(), [motion(i) for i in range(3)]), KNOWN)
    for i in range(3):
        alone = BASELINES["slerp"](Poses.of(skeleton(), [motion(i)]), KNOWN)
        np.testing.assert_allclose(together[0][i], alone[0][0], atol=1e-6)


def test_slerp_equals_scipy_on_local_rotations() -> None:
    one = motion(4)
    _, rotations = BASELINES["slerp"](Poses.of(skeleton(), [one]), KNOWN)
    keys = np.flatnonzero(KNOWN)
    expected: list[Rotation] = []
    for joint, parent in enumerate(PARENTS):
        own = Rotation.from_quat(one.rotations[keys, joint])
        local = own if parent < 0 else Rotation.from_quat(one.rotations[keys, parent]).inv() * own
        between = Slerp(keys, local)(np.arange(31))
        expected.append(between if parent < 0 else expected[parent] * between)
        error = Rotation.from_quat(rotations[0, :, joint]).inv() * expected[joint]
        assert error.magnitude().max() < 2e-3  # float32


def test_lerp_halves_the_way_in_the_world() -> None:
    poses = Poses.of(skeleton(), [motion(5)])
    positions, rotations = BASELINES["lerp"](poses, KNOWN)
    np.testing.assert_allclose(positions[0, 5], (poses.positions[0, 0] + poses.positions[0, 10]) / 2, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(rotations, axis=-1), 1, atol=1e-6)


def test_constant_velocity_is_exact_on_a_steady_motion() -> None:
    t = np.arange(31)
    spin = Rotation.from_rotvec(0.03 * t[:, None] * [0, 1, 0]).as_quat()
    steady = Motion(
        np.tile(spin[:, None], (1, 4, 1)).astype(np.float32), (0.01 * t[:, None] * [1, 0, 2]).astype(np.float32), 30.0
    )
    poses = Poses.of(skeleton(), [steady])
    positions, _ = PREDICTION_BASELINES["constant-velocity"](poses, PREDICTED)
    np.testing.assert_allclose(positions, poses.positions, atol=1e-4)
    held, _ = PREDICTION_BASELINES["zero-velocity"](poses, PREDICTED)
    np.testing.assert_array_equal(held[0, 21:], np.broadcast_to(held[0, 20], held[0, 21:].shape))


def _junk(one: Motion, known: np.ndarray) -> Motion:
    rotations, roots, tracks = one.rotations.copy(), one.root_positions.copy(), one.tracks.copy()
    rotations[~known] = [0.5, 0.5, 0.5, 0.5]
    roots[~known] = 9
    tracks[~known] = -7
    return Motion(rotations, roots, one.fps, one.track_joints, tracks)


def test_poses_follow_forward_kinematics() -> None:
    poses = Poses.of(skeleton(), [motion(6)])
    one = motion(6)
    head = one.root_positions[3] + Rotation.from_quat(one.rotations[3, 0]).apply(one.tracks[3, 0])
    assert torch.allclose(poses.positions[0, 3, 1], torch.as_tensor(head, dtype=torch.float32), atol=1e-5)
