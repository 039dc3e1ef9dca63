"""Plain interpolation: slerp against SciPy, keys exact, no kink where it is smooth, holds outside the keys."""

from __future__ import annotations

import numpy as np
import pytest
import roma
import torch
from scipy.spatial.transform import Rotation, Slerp

from data_schemas.errors import UsageError
from stages.kinematics.plain_interpolation import interpolate_pose

KEY_TIMES = torch.tensor([0.0, 3.75, 4.0, 11.0])


def keys(seed: int = 0) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    rng = np.random.default_rng(seed)
    local = torch.tensor(Rotation.random(4 * 3, rng=rng).as_quat().reshape(4, 3, 4), dtype=torch.float32)
    return local, torch.tensor(rng.normal(size=(4, 3)), dtype=torch.float32), torch.zeros(3, 3)


def test_is_scipy_slerp_and_linear():
    local, roots, offsets = keys()
    times = torch.linspace(0, 11, 57)
    out, out_roots, out_offsets = interpolate_pose(local, roots, offsets, KEY_TIMES, times)
    for joint in range(3):
        expected = Slerp(KEY_TIMES.numpy(), Rotation.from_quat(local[:, joint].numpy()))(times.numpy())
        error = (expected.inv() * Rotation.from_quat(out[:, joint].numpy())).magnitude()
        assert error.max() < 1e-3
    expected_roots = np.stack([np.interp(times, KEY_TIMES, roots[:, axis]) for axis in range(3)], -1)
    np.testing.assert_allclose(out_roots, expected_roots, atol=1e-6)
    assert out_offsets is offsets


@pytest.mark.parametrize("smooth", [0.0, 0.5, 1.0])
def test_keys_exact_and_held_outside(smooth: float):
    local, roots, offsets = keys()
    moving = offsets + torch.arange(4.0).view(4, 1, 1)
    times = torch.cat([torch.tensor([-5.0]), KEY_TIMES, torch.tensor([40.0])])
    rows = torch.tensor([0, 0, 1, 2, 3, 3])
    out, out_roots, out_offsets = interpolate_pose(local, roots, moving, KEY_TIMES, times, smooth=smooth)
    same = (out * local[rows]).sum(-1).abs()
    torch.testing.assert_close(same, torch.ones_like(same), atol=1e-6, rtol=0)
    torch.testing.assert_close(out_roots, roots[rows], atol=1e-6, rtol=0)
    torch.testing.assert_close(out_offsets, moving[rows], atol=1e-6, rtol=0)


def test_signs_continuous():
    local, roots, offsets = keys()
    local[2] *= -1
    out, _, _ = interpolate_pose(local, roots, offsets, KEY_TIMES, torch.linspace(0, 11, 400))
    assert ((out[1:] * out[:-1]).sum(-1) > 0).all()


def test_cubic_has_no_kink():
    local, roots, offsets = keys(3)
    step = 1e-2
    for key in KEY_TIMES[1:3]:
        times = key + torch.tensor([-step, 0.0, step])
        kinks = []
        for smooth in (0.0, 1.0):
            out, out_roots, _ = interpolate_pose(local, roots, offsets, KEY_TIMES, times, smooth=smooth)
            turns = roma.quat_product(roma.quat_conjugation(out[:-1]), out[1:])
            rates = roma.unitquat_to_rotvec(turns) / step
            kinks.append(
                ((rates[1] - rates[0]).norm(dim=-1).max(), (out_roots.diff(dim=0).diff(dim=0) / step).norm())
            )
        assert kinks[1][0] < 0.25 * kinks[0][0] and kinks[1][1] < 0.25 * kinks[0][1]


def test_cubic_follows_uniform_turn_and_parabola():
    times = torch.arange(0.0, 40.0, 10.0)
    angles = 0.05 * times
    local = roma.rotvec_to_unitquat(torch.stack([angles, 0 * angles, 0 * angles], -1))[:, None]
    roots = torch.stack([times**2, times, 0 * times], -1)
    fine = torch.arange(10.0, 20.0)
    out, out_roots, _ = interpolate_pose(local, roots, torch.zeros(1, 3), times, fine, smooth=1.0)
    torch.testing.assert_close(roma.unitquat_to_rotvec(out)[:, 0, 0], 0.05 * fine, atol=1e-4, rtol=0)
    torch.testing.assert_close(out_roots[:, 0], fine**2, atol=1e-2, rtol=0)


def test_one_key_is_held_and_bad_times_refused():
    local, roots, offsets = keys()
    out, _, _ = interpolate_pose(local[:1], roots[:1], offsets, KEY_TIMES[:1], torch.arange(5.0))
    assert (out == local[:1]).all()
    with pytest.raises(UsageError):
        interpolate_pose(local, roots, offsets, KEY_TIMES.flip(0), torch.arange(5.0))
