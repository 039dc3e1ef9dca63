"""Angles of hinges: exact where a motion is one of theirs, near, without jumps and within limits where it is not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stages.shared.formats import hinge_fit
from stages.shared.formats.hinge_fit import fit_hinges
from stages.shared.formats.hinges import Hinges
from stages.shared.formats.robot_rig import robot_rig
from tests.shared.formats.robot_files import ANGLES, RobotText, some_rows

HINGES = robot_rig(RobotText().urdf(), "t.urdf").hinges
MIMIC = robot_rig(RobotText(mimics={"right_wrist_joint": ("left_wrist_joint", -0.5, 0.2)}).urdf(), "t.urdf").hinges


def _pose(hinges: Hinges, angles: np.ndarray) -> np.ndarray:
    """(T, J, 4) float32, of a root that turns."""
    root = Rotation.from_euler("ZYX", np.outer(np.arange(len(angles)), [0.1, 0.02, -0.03])).as_quat()
    return hinges.poses(root, angles)[1].astype(np.float32)


@pytest.mark.parametrize("hinges", [HINGES, MIMIC], ids=["plain", "mimic"])
@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), size=st.floats(0.01, 1.9))
def test_angles_come_back_from_their_poses(hinges: Hinges, seed: int, size: float) -> None:
    angles = np.random.default_rng(seed).uniform(-size, size, (3, len(hinges.limits)))
    found = fit_hinges(hinges, _pose(hinges, angles), 30.0)
    assert not found.fitted.any() and not found.held.any()
    wheels = ~np.isfinite(hinges.limits).all(axis=1)
    apart = found.angles - angles
    apart[:, wheels] -= 2 * np.pi * np.round(apart[:, wheels] / (2 * np.pi))
    assert np.allclose(apart, 0, atol=5e-6) and found.off_m.max() < 1e-5


def test_whole_turns_do_not_jump() -> None:
    angles = np.zeros((60, len(ANGLES)))
    wrist = ANGLES.index("left_wrist_joint")
    angles[:, wrist] = np.linspace(-2, 9, 60)
    found = fit_hinges(HINGES, _pose(HINGES, angles), 30.0).angles[:, wrist]
    assert np.allclose(np.diff(found), np.diff(angles[:, wrist]), atol=1e-5)


def _freely_turned(frames: int = 60) -> np.ndarray:
    """Poses of hinges whose joints then turned about any axes, smoothly, by some 20 degrees."""
    rng = np.random.default_rng(1)
    poses = _pose(HINGES, some_rows(frames)[:, 7:])
    waves = np.sin(np.arange(frames)[:, None, None] / 9 + rng.uniform(0, 6, (1, poses.shape[1], 3)))
    turned = Rotation.from_rotvec(0.25 * waves.reshape(-1, 3)) * Rotation.from_quat(poses.reshape(-1, 4))
    return turned.as_quat().reshape(poses.shape)


def _misses(angles: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """(T,) metres, mean over the limbs' ends."""
    apart = HINGES.poses(wanted[:, 0], angles)[0] - HINGES.heads(wanted)
    return np.linalg.norm(apart, axis=-1)[:, HINGES.leaves].mean(axis=1)


def test_a_free_motion_is_approximated_without_jumps() -> None:
    wanted = _freely_turned()
    own, left_over = hinge_fit._own_turns(HINGES, wanted)
    found = fit_hinges(HINGES, wanted, 30.0)
    assert left_over.min() > 0.1 and found.fitted.all()
    assert _misses(found.angles, wanted).mean() < 0.5 * _misses(own, wanted).mean()
    assert _misses(found.angles, wanted).mean() < 0.05
    assert np.abs(np.diff(found.angles, axis=0)).max() < np.radians(25)


def test_frames_that_hinges_can_reproduce_are_not_changed() -> None:
    angles = some_rows(40)[:, 7:]
    wanted = _pose(HINGES, angles).astype(np.float64)
    wanted[10:30] = _freely_turned(40)[10:30]
    found = fit_hinges(HINGES, wanted, 30.0)
    assert np.flatnonzero(found.fitted).tolist() == list(range(10, 30))
    assert np.allclose(found.angles[:10], angles[:10], atol=1e-5)
    assert np.allclose(found.angles[30:], angles[30:], atol=1e-5)


def test_limits_hold_and_are_reported() -> None:
    narrow = robot_rig(RobotText(limits=(-0.2, 0.3)).urdf(), "t.urdf").hinges
    angles = some_rows(40)[:, 7:]
    beyond = narrow.beyond(angles)
    assert beyond.any()
    free = fit_hinges(narrow, _pose(narrow, angles), 30.0)
    assert np.array_equal(narrow.beyond(free.angles), beyond) and not free.held.any()
    held = fit_hinges(narrow, _pose(narrow, angles), 30.0, limited=True)
    assert np.allclose(held.angles, narrow.within(angles), atol=1e-5) and np.array_equal(held.held, beyond)
    fitted = fit_hinges(narrow, _freely_turned(), 30.0, limited=True)
    assert not narrow.beyond(fitted.angles, slack_rad=0).any() and fitted.held.any()


def test_runs_are_joined(monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = _freely_turned(50)
    whole = fit_hinges(HINGES, wanted, 30.0)
    monkeypatch.setattr(hinge_fit, "_RUN", 20)
    parts = fit_hinges(HINGES, wanted, 30.0)
    assert np.abs(np.diff(parts.angles, axis=0)).max() < 1.5 * np.abs(np.diff(whole.angles, axis=0)).max()
    assert _misses(parts.angles, wanted).mean() < 1.1 * _misses(whole.angles, wanted).mean()


def test_the_derivatives_are_those_of_the_poses() -> None:
    wanted = _freely_turned(6)
    run = hinge_fit._Run(MIMIC, wanted, np.zeros((6, len(MIMIC.limits))), slice(1, 5), False, 0.01)
    run.angles = np.random.default_rng(0).uniform(-0.5, 0.5, run.angles.shape)
    _, slope = run._equations()
    step, start = 1e-6, run.angles.copy()
    for frame, angle in ((0, 3), (1, 0), (3, len(MIMIC.limits) - 1), (2, ANGLES.index("left_wrist_joint"))):
        sides = []
        for sign in (1, -1):
            changed = start.copy()
            changed[frame, angle] += sign * step
            sides.append(run._cost(changed))
        downhill = -(sides[0] - sides[1]) / (2 * step) / 2
        assert slope[frame, angle] == pytest.approx(downhill, rel=0.15, abs=2e-4)  # directions' are to first order
