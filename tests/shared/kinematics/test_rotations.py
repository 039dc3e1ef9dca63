"""Signs, products and shortest turns: against SciPy, and the same from NumPy arrays as from torch tensors."""

from __future__ import annotations

import numpy as np
import pytest
import roma
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from data_schemas import packed_transforms
from stages.shared.kinematics import forward, forward_numpy, rotations


def some_quaternions(*shape: int, seed: int = 0) -> np.ndarray:
    drawn = np.random.default_rng(seed).standard_normal((*shape, 4))
    return drawn / np.linalg.norm(drawn, axis=-1, keepdims=True)


def as_rotations(quaternions: np.ndarray) -> Rotation:
    return Rotation.from_quat(quaternions.reshape(-1, 4))


def test_continuous_signs_remove_jumps_and_change_no_rotation() -> None:
    smooth = Rotation.from_rotvec(np.linspace(0, 6, 40)[:, None] * [0, 1, 0]).as_quat()[:, None]
    flipped = smooth * np.random.default_rng(0).choice([-1, 1], size=(40, 1, 1))
    out = rotations.continuous_signs(flipped)
    assert ((out[1:] * out[:-1]).sum(-1) > 0).all()
    assert np.array_equal(out[0], flipped[0]) and np.array_equal(abs(out), abs(flipped))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("axis", [0, 1])
def test_numpy_and_torch_choose_the_same_signs(dtype: type, axis: int) -> None:
    one, other = (some_quaternions(30, 20, 5, seed=seed).astype(dtype) for seed in (1, 2))
    pairs = [
        (rotations.continuous_signs(one, axis), rotations.continuous_signs(torch.from_numpy(one), axis)),
        (rotations.aligned_signs(one, other), rotations.aligned_signs(*map(torch.from_numpy, (one, other)))),
        (rotations.shorter_way(one), rotations.shorter_way(torch.from_numpy(one))),
    ]
    for array, tensor in pairs:
        assert array.dtype == dtype and array.tobytes() == tensor.numpy().tobytes()


def test_packed_clouds_have_the_same_signs() -> None:
    """`data_schemas` stands below the stages and cannot import them, so it has the rule a second time."""
    turns = some_quaternions(50, 4, seed=3)
    assert np.array_equal(packed_transforms._continuous(turns.copy()), rotations.continuous_signs(turns))


def test_rows_that_are_given_keep_their_signs() -> None:
    turns = some_quaternions(60, 3, seed=4)
    given = np.random.default_rng(5).random(60) < 0.3
    out = rotations.signs_after_given(turns, given)
    agree = (out[1:] * out[:-1]).sum(-1) >= 0
    assert np.array_equal(out[given], turns[given]) and agree[~given[1:]].all() and not agree.all()


def test_products_and_turned_vectors_agree_with_scipy() -> None:
    a, b = some_quaternions(40, seed=6), some_quaternions(40, seed=7)
    vectors = np.random.default_rng(8).normal(size=(40, 3))
    product = as_rotations(rotations.multiply(a, b))
    assert (product.inv() * as_rotations(a) * as_rotations(b)).magnitude().max() < 1e-12
    assert np.allclose(rotations.rotate(a, vectors), as_rotations(a).apply(vectors))
    assert np.allclose(rotations.multiply(a, a * rotations.CONJUGATE), [0, 0, 0, 1])


def test_turns_between_lead_from_one_to_the_other_the_shorter_way() -> None:
    a, b = some_quaternions(40, seed=9), some_quaternions(40, seed=10)
    turns = rotations.turns_between(torch.from_numpy(a), torch.from_numpy(b)).numpy()
    assert np.linalg.norm(turns, axis=-1).max() <= np.pi
    reached = as_rotations(a) * Rotation.from_rotvec(turns)
    assert (reached.inv() * as_rotations(b)).magnitude().max() < 1e-12


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), angle=st.floats(0, np.pi), flip=st.booleans())
def test_angles_between_are_those_that_were_put_in_down_to_none(seed: int, angle: float, flip: bool) -> None:
    first = some_quaternions(5, seed=seed)
    axes = np.random.default_rng(seed).standard_normal((5, 3))
    turn = Rotation.from_rotvec(angle * axes / np.linalg.norm(axes, axis=-1, keepdims=True))
    second = (as_rotations(first) * turn).as_quat() * (-1 if flip else 1)
    np.testing.assert_allclose(rotations.angles_between(first, second), angle, rtol=1e-6, atol=1e-9)
    assert (rotations.angles_between(first, -first) == 0).all()


def test_slerp_agrees_with_scipy() -> None:
    a, b = some_quaternions(25, seed=11), some_quaternions(25, seed=12)
    shares = np.random.default_rng(13).random((25, 1))
    for first, second, share, got in zip(a, b, shares, rotations.slerp(a, b, shares), strict=True):
        expected = Slerp([0, 1], Rotation.from_quat([first, second]))(share)
        assert (expected.inv() * Rotation.from_quat(got)).magnitude().max() < 1e-7
    assert np.allclose(rotations.slerp(a, -a, shares), a)


def test_the_smallest_turn_is_the_same_for_arrays_and_tensors() -> None:
    rng = np.random.default_rng(14)
    directions, targets = rng.normal(size=(2, 60, 3))
    targets[0], targets[1], targets[2] = -directions[0], 3 * directions[1], 0
    directions[3], targets[3] = [0, 1, 0], [0, -1, 0]
    turns = rotations.smallest_turn(directions, targets)
    turned = as_rotations(turns).apply(directions / np.linalg.norm(directions, axis=1, keepdims=True))
    wanted = targets / np.maximum(np.linalg.norm(targets, axis=1, keepdims=True), 1e-9)
    assert np.allclose(np.delete(turned, 2, 0), np.delete(wanted, 2, 0), atol=1e-9)
    assert np.allclose(turns[2], [0, 0, 0, 1]) and (turns[:, 3] >= 0).all()
    across = np.cross(directions, wanted)
    assert np.allclose(np.cross(across, turns[:, :3])[4:], 0)  # about the axis across both, so no shorter turn exists
    tensors = rotations.smallest_turn(torch.from_numpy(directions), torch.from_numpy(targets))
    assert np.allclose(tensors.numpy(), turns, atol=1e-12)


def test_forward_kinematics_in_numpy_and_in_torch_agree() -> None:
    parents = np.array([-1, 0, 1, 1, 0, 4])
    local, offsets = some_quaternions(20, 6, seed=15), np.random.default_rng(16).normal(size=(6, 3))
    roots = np.random.default_rng(17).normal(size=(20, 3))
    world = forward_numpy.global_rotations(local, parents)
    expected = forward.global_rotations(torch.from_numpy(local), parents)
    assert np.allclose(world, expected.numpy(), atol=1e-12)
    back = forward_numpy.local_rotations(world, parents)
    assert np.allclose(back, forward.local_rotations(expected, parents).numpy(), atol=1e-12)
    heads = forward_numpy.joint_positions(world, roots, offsets, parents)
    tensors = forward.joint_positions(expected, torch.from_numpy(roots), torch.from_numpy(offsets), parents)
    assert np.allclose(heads, tensors.numpy(), atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.sampled_from([0.0, 1e-12, 1e-7, 1e-4, 1e-2, 1.0, 3.0, np.pi - 1e-6]),
    dtype=st.sampled_from([torch.float32, torch.float64]),
)
def test_tensors_turn_as_roma_turns_them(seed: int, size: float, dtype: torch.dtype) -> None:
    """Products, turned vectors, vectors of turns and matrices: an independent library, from no turn to a half one."""
    drawn = np.random.default_rng(seed)
    a, b = (torch.from_numpy(some_quaternions(7, seed=drawn.integers(2**31))).to(dtype) for _ in range(2))
    places = torch.from_numpy(drawn.normal(size=(7, 3))).to(dtype)
    directions = drawn.normal(size=(7, 3))
    turns = torch.from_numpy(size * directions / np.linalg.norm(directions, axis=-1, keepdims=True)).to(dtype)
    near = {"rtol": 0.0, "atol": 2e-6 if dtype == torch.float32 else 1e-13}
    step = rotations.from_turn_vectors(turns)
    close = torch.testing.assert_close
    close(rotations.multiply(a, b), roma.quat_product(a, b), **near)
    close(rotations.conjugate(a), roma.quat_conjugation(a), **near)
    close(rotations.rotate(a, places), roma.quat_action(a, places), **near)
    close(rotations.matrices(a), roma.unitquat_to_rotmat(a), **near)
    close(step, roma.rotvec_to_unitquat(turns), **near)
    close(rotations.matrices(step), roma.rotvec_to_rotmat(turns), **near)
    close(rotations.turn_vectors(a), roma.unitquat_to_rotvec(a), rtol=0.0, atol=3 * near["atol"])
    if size < 3.1:  # at a half turn both signs of the axis are right
        close(rotations.turn_vectors(step), turns, rtol=0.0, atol=10 * near["atol"])
    back = rotations.from_matrices(rotations.matrices(a))
    close(rotations.aligned_signs(back, a), a, rtol=0.0, atol=3 * near["atol"])


@pytest.mark.parametrize("size", [0.0, 1e-9, 0.3, 2.0])
def test_gradients_of_turns_are_right_down_to_no_turn(size: float) -> None:
    vectors = torch.tensor([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0]], dtype=torch.float64) * size
    vectors.requires_grad_()
    assert torch.autograd.gradcheck(rotations.from_turn_vectors, vectors)
    assert torch.autograd.gradcheck(lambda v: rotations.turn_vectors(rotations.from_turn_vectors(v)), vectors)
    step = rotations.from_turn_vectors(vectors).detach().requires_grad_()
    assert torch.autograd.gradcheck(rotations.matrices, step)
    assert torch.autograd.gradcheck(rotations.multiply, (step, step.detach().flip(0).requires_grad_()))


def test_tensors_of_different_ranks_broadcast() -> None:
    many = torch.from_numpy(some_quaternions(5, 6, seed=9))
    one = torch.from_numpy(some_quaternions(6, seed=10))
    assert torch.equal(rotations.multiply(many, one), rotations.multiply(many, one.expand(5, 6, 4)))
    assert torch.equal(rotations.multiply(one, many), rotations.multiply(one.expand(5, 6, 4), many))
    assert torch.equal(rotations.rotate(one, many[..., :3]), rotations.rotate(one.expand(5, 6, 4), many[..., :3]))
