"""Plain interpolation: slerp against SciPy, keys exact, no kink where it is smooth, holds outside the keys."""

from __future__ import annotations

import numpy as np
import pytest
import roma
import torch
from scipy.spatial.transform import Rotation, Slerp

from data_schemas.errors import UsageError
from stages.shared.kinematics.plain_interpolation import Glide, damped_smoothness, interpolate_pose

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
    local, roots, offsets = keys(3)  # turns as fast as no limb makes
    free = torch.ones(3, dtype=torch.bool)
    step = 1e-2
    for key in KEY_TIMES[1:3]:
        times = key + torch.tensor([-step, 0.0, step])
        kinks = []
        for smooth in (0.0, 1.0):
            out, out_roots, _ = interpolate_pose(
                local, roots, offsets, KEY_TIMES, times, smooth=smooth, whole_turns=free
            )
            turns = roma.quat_product(roma.quat_conjugation(out[:-1]), out[1:])
            rates = roma.unitquat_to_rotvec(turns) / step
            kinks.append(
                ((rates[1] - rates[0]).norm(dim=-1).max(), (out_roots.diff(dim=0).diff(dim=0) / step).norm())
            )
        assert kinks[1][0] < 0.25 * kinks[0][0] and kinks[1][1] < 0.25 * kinks[0][1]


def test_damping_lets_places_go_on_where_rotations_turn_straight():
    """A body that moves and turns up to a key, and is where it was two seconds later: its path keeps half of
    the cubic's swing, its rotation little."""
    times = torch.tensor([0.0, 1.0, 61.0])
    angles = torch.tensor([0.0, 0.02, 0.02])
    local = roma.rotvec_to_unitquat(torch.stack([angles, 0 * angles, 0 * angles], -1))[:, None]
    roots = torch.stack([angles, 0 * angles, 0 * angles], -1)
    fine = torch.arange(1.0, 61.0)
    swings = []
    for smooth in (1.0, damped_smoothness(times, 30.0)):
        out, places, _ = interpolate_pose(local, roots, torch.zeros(1, 3), times, fine, smooth=smooth)
        swings.append(torch.stack([roma.unitquat_to_rotvec(out)[:, 0, 0], places[:, 0]]).amax(1) - 0.02)
    turn, place = swings[1] / swings[0]
    assert turn < 0.25 and place > 0.45


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


def test_beyond_the_keys_it_glides_on_at_the_speed_it_has_and_comes_to_rest():
    local, roots, offsets = keys()
    glide = Glide(root=6.0, turn=2.0)
    away = torch.tensor([1e-3, 1.0, 5.0, 500.0])
    times = torch.cat([KEY_TIMES, KEY_TIMES[-1] + away, KEY_TIMES[0] - away])
    held = interpolate_pose(local, roots, offsets, KEY_TIMES, times)
    out, places, _ = interpolate_pose(local, roots, offsets, KEY_TIMES, times, glide=glide)
    assert (out[:4] == held[0][:4]).all() and (places[:4] == held[1][:4]).all()
    for edge, inner, rows in ((3, 2, slice(4, 8)), (0, 1, slice(8, 12))):
        gap = float((KEY_TIMES[edge] - KEY_TIMES[inner]).abs())
        moved = (roots[edge] - roots[inner]) * (6.0 * (1 - torch.exp(-away / 6.0)) / gap).unsqueeze(1)
        torch.testing.assert_close(places[rows], roots[edge] + moved, atol=1e-5, rtol=1e-5)
        # SciPy: the last turn between keys, made again by the share that an exponential decay leaves.
        first, last = (Rotation.from_quat(local[key].numpy()) for key in (inner, edge))
        for row, span in zip(range(rows.start, rows.stop), away.tolist(), strict=True):
            share = 2.0 * (1 - np.exp(-span / 2.0)) / gap
            expected = last * Rotation.from_rotvec((first.inv() * last).as_rotvec() * share)
            assert (expected.inv() * Rotation.from_quat(out[row].numpy())).magnitude().max() < 2e-3


def test_a_glide_of_nothing_holds_to_the_bit_and_one_key_is_held():
    local, roots, offsets = keys()
    times = torch.linspace(-5, 20, 40)
    held = interpolate_pose(local, roots, offsets, KEY_TIMES, times)
    still = interpolate_pose(local, roots, offsets, KEY_TIMES, times, glide=Glide(0.0, 0.0))
    assert all((one == other).all() for one, other in zip(held, still, strict=True))
    single = interpolate_pose(local[:1], roots[:1], offsets, KEY_TIMES[:1], times, glide=Glide(3.0, 3.0))
    assert (single[1] == roots[0]).all() and (single[0] == local[0]).all()
