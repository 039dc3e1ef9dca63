"""Matrices against quaternions and SciPy: columns, forward kinematics, angles, gradients."""

from __future__ import annotations

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stages.shared.kinematics.forward import global_rotations, joint_positions
from stages.shared.kinematics.matrix_poses import (
    angles_of_matrices,
    columns_of_matrices,
    global_matrices,
    matrices_of_columns,
    positions_of_matrices,
)
from stages.shared.kinematics.rotations import matrices


def _tree(rng: np.random.Generator, joints: int) -> np.ndarray:
    return np.array([-1, *(int(rng.integers(joint)) for joint in range(1, joints))])


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 12))
def test_forward_kinematics_agrees_with_quaternions(seed: int, joints: int):
    rng = np.random.default_rng(seed)
    parents = _tree(rng, joints)
    local = torch.from_numpy(Rotation.random(3 * joints, rng).as_quat()).reshape(3, joints, 4)
    offsets = torch.from_numpy(rng.normal(size=(joints, 3)))
    offsets[0] = 0
    whole = global_matrices(matrices(local), parents)
    wanted = global_rotations(local, parents)
    torch.testing.assert_close(whole, matrices(wanted))
    places = joint_positions(wanted, torch.zeros(3, 3, dtype=torch.float64), offsets, parents)
    torch.testing.assert_close(positions_of_matrices(whole, offsets, parents), places)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_columns_and_back(seed: int):
    turns = torch.from_numpy(Rotation.random(5, np.random.default_rng(seed)).as_matrix())
    torch.testing.assert_close(matrices_of_columns(columns_of_matrices(turns)), turns)


def test_columns_of_any_length_and_angle_give_rotations():
    made = matrices_of_columns(torch.randn(40, 6, generator=torch.Generator().manual_seed(1)).double())
    torch.testing.assert_close(made @ made.transpose(-1, -2), torch.eye(3).double().expand(40, 3, 3))
    torch.testing.assert_close(torch.linalg.det(made), torch.ones(40).double())


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_angles_agree_with_scipy(seed: int):
    first, second = (Rotation.random(8, np.random.default_rng((seed, i))) for i in range(2))
    wanted = (first * second.inv()).magnitude()
    found = angles_of_matrices(torch.from_numpy(first.as_matrix()), torch.from_numpy(second.as_matrix()))
    np.testing.assert_allclose(found.numpy(), np.minimum(wanted, np.pi - 2e-3), atol=3e-3)
    near = wanted < 3.0
    np.testing.assert_allclose(found.numpy()[near], wanted[near], atol=1e-5)


def test_the_angle_s_slope_is_finite_where_rotations_are_equal_or_opposite():
    turn = torch.diag(torch.tensor([1.0, -1.0, -1.0])).expand(2, 3, 3).clone().requires_grad_()
    other = torch.stack([turn[0].detach(), torch.eye(3)])  # equal, and half a turn away
    angles = angles_of_matrices(turn, other)
    angles.sum().backward()
    assert turn.grad is not None and torch.isfinite(turn.grad).all()
    assert angles[0] < 1e-5 and angles[1] > 3.13
