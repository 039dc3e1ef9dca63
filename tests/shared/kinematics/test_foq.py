"""First-frame offsets: there and back, blind to every constant roll, right about the sign and the side."""

from __future__ import annotations

import numpy as np
import pytest
import roma
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stages.shared.kinematics.foq import first_frame_offsets, rotations_from_offsets

FRAMES, JOINTS = 17, 5
angles = st.floats(-2 * np.pi, 2 * np.pi)
directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-3)


def wandering(seed: int = 0, windows: int = 2) -> torch.Tensor:
    """Sign-continuous random walks of rotations, (windows, FRAMES, JOINTS, 4)."""
    rng = np.random.default_rng(seed)
    steps = torch.tensor(rng.normal(size=(windows, FRAMES, JOINTS, 3)) * 0.4, dtype=torch.float32)
    walk = [torch.nn.functional.normalize(torch.tensor(rng.normal(size=(windows, JOINTS, 4))).float(), dim=-1)]
    for frame in range(1, FRAMES):
        walk.append(roma.quat_product(roma.rotvec_to_unitquat(steps[:, frame]), walk[-1]))
    return torch.stack(walk, dim=1)


def test_there_and_back():
    rotations = wandering()
    foq = first_frame_offsets(rotations)
    for frame in (0, 3, FRAMES - 1):
        torch.testing.assert_close(
            rotations_from_offsets(foq, rotations[:, frame], frame), rotations, atol=1e-6, rtol=0
        )


def test_the_first_frame_is_the_identity_and_signs_stay_continuous():
    foq = first_frame_offsets(wandering(1))
    torch.testing.assert_close(foq[:, 0], torch.tensor([0.0, 0, 0, 1]).expand_as(foq[:, 0]), atol=1e-6, rtol=0)
    assert ((foq[:, 1:] * foq[:, :-1]).sum(-1) > 0).all()
    torch.testing.assert_close(foq.norm(dim=-1), torch.ones(foq.shape[:-1]), atol=1e-6, rtol=0)


@settings(max_examples=40, deadline=None)
@given(tail=directions, angle=angles, seed=st.integers(0, 1000))
def test_any_constant_roll_about_the_bone_falls_out(tail, angle, seed):
    rotations = wandering(seed, windows=1)
    axis = torch.tensor(tail, dtype=torch.float32) / float(np.linalg.norm(tail))
    roll = roma.rotvec_to_unitquat(angle * axis)
    rolled = roma.quat_product(rotations, roll.expand_as(rotations))
    torch.testing.assert_close(first_frame_offsets(rolled), first_frame_offsets(rotations), atol=1e-5, rtol=0)
    # The roll is real (the bone points where it did, its frame does not), and comes back from the known frame.
    points = torch.tensor(tail, dtype=torch.float32).expand(*rotations.shape[:-1], 3)
    torch.testing.assert_close(
        roma.quat_action(rolled, points), roma.quat_action(rotations, points), atol=1e-5, rtol=0
    )
    back = rotations_from_offsets(first_frame_offsets(rotations), rolled[:, 0])
    torch.testing.assert_close(back, rolled, atol=1e-5, rtol=0)


def test_is_a_rotation_about_the_worlds_axes():
    """A body that turns by a about the world's Y has FOQ of a about Y, however its bones lay in the first frame."""
    first = wandering(2)[:, :1]
    turns = roma.rotvec_to_unitquat(torch.tensor([[0.0, a, 0.0] for a in np.linspace(0, 3, FRAMES)]).float())
    rotations = roma.quat_product(turns[None, :, None].expand(2, -1, JOINTS, 4), first.expand(2, FRAMES, JOINTS, 4))
    expected = turns[None, :, None].expand(2, -1, JOINTS, 4)
    torch.testing.assert_close(first_frame_offsets(rotations), expected, atol=1e-6, rtol=0)


@pytest.mark.parametrize("frame", [1, FRAMES - 1])
def test_agrees_with_scipy(frame: int):
    rotations = wandering(3)
    flat = [Rotation.from_quat(rotations[:, at].reshape(-1, 4).numpy()) for at in (0, frame)]
    expected = (flat[1] * flat[0].inv()).as_matrix()
    found = Rotation.from_quat(first_frame_offsets(rotations)[:, frame].reshape(-1, 4).numpy()).as_matrix()
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_distances_are_those_of_the_rotations():
    one, other = wandering(4), wandering(5)
    other = roma.quat_product(
        other, roma.quat_product(roma.quat_conjugation(other[:, :1]), one[:, :1]).expand_as(other)
    )
    torch.testing.assert_close(
        (first_frame_offsets(one) - first_frame_offsets(other)).norm(dim=-1),
        (one - other).norm(dim=-1), atol=1e-5, rtol=0,
    )  # fmt: skip
