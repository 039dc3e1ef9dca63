"""How far a joint turns between two keys: no further than the keys and the velocities at them ask for."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from stages.shared.kinematics.joint_tree import pelvis_and_above
from stages.shared.kinematics.plain_interpolation import MOST_MIDDLE_RAD, interpolate_pose
from stages.shared.kinematics.window_interpolation import interpolate_windows

FINE = 240
KNEE = [0.0, 16.0, 32.0, 42.0, 58.0, 74.0]  # bends by 16 degrees a frame at both ends of a gap of 30 frames
KNEE_TIMES = [0.0, 1.0, 2.0, 32.0, 33.0, 34.0]
steps_deg = st.floats(-179.0, 179.0)
lengths = st.sampled_from([1.0, 1.0, 2.0, 15.0, 30.0, 60.0])
smoothness = st.sampled_from([0.3, 0.7, 1.0])


def _about(axis: int, degrees: np.ndarray | float) -> Rotation:
    return Rotation.from_rotvec(np.deg2rad(degrees)[..., None] * np.eye(3)[axis])


def _between(quaternions: np.ndarray, times: np.ndarray, segment: int, smooth: float) -> np.ndarray:
    """(FINE, 4) a joint's rotations from one key to the next, both included."""
    local = torch.as_tensor(quaternions, dtype=torch.float32)[:, None]
    fine = torch.as_tensor(np.linspace(times[segment], times[segment + 1], FINE))
    zeros = torch.zeros(len(times), 3)
    made, _, _ = interpolate_pose(local, zeros, zeros[:1], torch.as_tensor(times), fine, smooth=smooth)
    return made[:, 0].double().numpy()


def _slopes_at_keys(steps: np.ndarray, spans: np.ndarray) -> np.ndarray:
    """(K, C) slopes of the parabolas through neighbouring keys; an end key has its segment's mean slope."""
    mean = steps / spans[:, None]
    inner = (spans[1:, None] * mean[:-1] + spans[:-1, None] * mean[1:]) / (spans[1:] + spans[:-1])[:, None]
    return np.concatenate([mean[:1], inner, mean[-1:]])


@settings(max_examples=150, deadline=None)
@given(st.lists(st.tuples(steps_deg, lengths), min_size=2, max_size=5), smoothness)
@example(list(zip(np.diff(KNEE).tolist(), np.diff(KNEE_TIMES).tolist(), strict=True)), 1.0)
def test_about_one_axis_an_angle_stays_where_its_hermite_curve_goes(keys, smooth):
    steps, spans = np.array(keys).T
    angles, times = np.r_[0.0, np.cumsum(steps)], np.r_[0.0, np.cumsum(spans)]
    mean, slopes = steps / spans, _slopes_at_keys(steps[:, None], spans)[:, 0]
    quaternions = _about(0, angles).as_quat()
    for segment in range(len(spans)):
        ends = mean[segment] + smooth * (slopes[segment : segment + 2] - mean[segment])
        pair = slice(segment, segment + 2)
        asked = CubicHermiteSpline(times[pair], angles[pair], ends)(np.linspace(*times[pair], FINE))
        made = _between(quaternions, times, segment, smooth)
        path = np.rad2deg(np.unwrap(2 * np.arctan2(made[:, 0], made[:, 3])))
        path += 360 * np.round((angles[segment] - path[0]) / 360)
        assert path.min() > min(asked.min(), *angles[pair]) - 0.1
        assert path.max() < max(asked.max(), *angles[pair]) + 0.1
        assert abs(path[-1] - angles[segment + 1]) < 0.1


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**32 - 1), st.lists(lengths, min_size=2, max_size=5), st.floats(0.1, 1.0), smoothness)
def test_about_any_axes_a_joint_arrives_without_a_turn_right_round(seed, spans, size, smooth):
    spans, rng = np.array(spans), np.random.default_rng(seed)
    axes = rng.normal(size=(len(spans), 3))
    steps = axes / np.linalg.norm(axes, axis=1, keepdims=True) * rng.uniform(0, size * 3.1, (len(spans), 1))
    turns = [Rotation.random(rng=rng)]
    for step in steps:
        turns.append(turns[-1] * Rotation.from_rotvec(step))
    quaternions = np.stack([turn.as_quat() for turn in turns])
    times = np.r_[0.0, np.cumsum(spans)]
    slopes = _slopes_at_keys(steps, spans)
    for segment, (step, span) in enumerate(zip(steps, spans, strict=True)):
        path = _between(quaternions, times, segment, smooth)
        dots = (path[1:] * path[:-1]).sum(1)
        assert (dots > 0).all()  # signs are continuous, so the end's sign says how often it went round
        assert path[0] @ path[-1] > -1e-4
        away = smooth * span / 3 * np.linalg.norm(slopes[segment : segment + 2] - step / span, axis=1).sum()
        turned = 4 * np.arcsin(np.linalg.norm(np.diff(path, axis=0), axis=1) / 2).sum()
        most = np.linalg.norm(step) + 2 * min(away, MOST_MIDDLE_RAD)
        assert turned < most + 0.02


def test_a_body_that_spins_goes_on_round_and_a_limb_comes_back():
    times = np.array([0.0, 1.0, 2.0, 18.0, 19.0, 20.0])
    spin = _about(1, 12.5 * times).as_quat()
    local = torch.as_tensor(np.stack([spin, spin], 1), dtype=torch.float32)
    zeros = torch.zeros(len(times), 3)
    middle = torch.tensor([10.0], dtype=torch.float64)
    made, _, _ = interpolate_pose(
        local, zeros, torch.zeros(2, 3), torch.as_tensor(times), middle, smooth=1.0,
        whole_turns=torch.from_numpy(pelvis_and_above(np.array([-1, 0]), 0)),
    )  # fmt: skip
    spun, limb = Rotation.from_quat(made[0].numpy())
    assert (spun * _about(1, -125)).magnitude() < np.deg2rad(3)
    assert (limb * _about(1, -125)).magnitude() > np.deg2rad(120)


@pytest.mark.parametrize("pelvis", [0, 1])
def test_the_joints_that_turn_the_body(pelvis):
    expected = [[True, False, False], [True, True, False]][pelvis]
    assert pelvis_and_above(np.array([-1, 0, 1]), pelvis).tolist() == expected


def test_in_windows_the_pelvis_alone_may_turn_right_round():
    known = torch.zeros(1, 35, dtype=torch.bool)
    known[:, [0, 1, 2, 18, 19, 20, 34]] = True
    turn = torch.as_tensor(_about(1, 12.5 * np.arange(35)).as_quat()).float()
    still = torch.zeros_like(turn)
    still[:, 3] = 1
    spins, swings = torch.stack([turn, turn], 1)[None], torch.stack([still, turn], 1)[None]
    heads, parents = torch.zeros(1, 35, 2, 3), torch.tensor([[-1, 0]])
    for rotations, bone, followed in ((spins, 0, True), (swings, 1, False)):
        _, made = interpolate_windows(heads, rotations, parents, known, rate_hz=30.0)
        off = Rotation.from_quat(made[0, 10, bone].numpy()) * Rotation.from_quat(rotations[0, 10, bone].numpy()).inv()
        assert (off.magnitude() < np.deg2rad(10)) == followed
