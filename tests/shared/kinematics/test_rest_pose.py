"""Rest-pose augmentation: tails meet their targets by the smallest turn; positions stay where lengths do."""

from __future__ import annotations

import numpy as np
import pytest
import roma
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from stages.shared.kinematics.foq import first_frame_offsets
from stages.shared.kinematics.forward import joint_positions
from stages.shared.kinematics.rest_pose import carried_offsets, moved_rest_pose, realign, smallest_turn
from tests.shared.training.tiny_clouds import PARENTS, TAILS, swinging

vectors = st.tuples(*[st.floats(-2, 2)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-2)


def direction(values: torch.Tensor) -> torch.Tensor:
    return torch.nn.functional.normalize(values, dim=-1)


@settings(max_examples=80, deadline=None)
@given(tail=vectors, target=vectors)
def test_the_tail_meets_its_target_by_the_smallest_turn(tail, target):
    eta, omega = torch.tensor(tail), torch.tensor(target)
    turn = smallest_turn(eta, omega)
    assert turn[3] >= 0
    assert abs(float(turn.norm()) - 1) < 1e-6
    torch.testing.assert_close(direction(roma.quat_action(turn, eta)), direction(omega), atol=1e-5, rtol=0)
    # All turns that do it are this one after a roll about the tail: none has a larger real part.
    rolls = roma.rotvec_to_unitquat(torch.linspace(-np.pi, np.pi, 73)[:, None] * direction(eta))
    others = roma.quat_product(turn.expand(73, 4), rolls)
    assert others[:, 3].abs().max() <= turn[3] + 1e-6


@pytest.mark.parametrize("tail", [(1.0, 0, 0), (0, -2.0, 0), (0.3, 0.4, -0.5)])
@pytest.mark.parametrize("off", [0.0, 1e-9, 1e-6, 1e-3])
def test_opposite_directions_turn_by_half_a_circle(tail, off):
    eta = torch.tensor(tail, dtype=torch.float64)
    omega = -eta + off * torch.tensor([0.1, 0.7, -0.2], dtype=torch.float64)
    turn = smallest_turn(eta, omega)
    assert torch.isfinite(turn).all()
    assert 0 <= turn[3] < 1e-2
    torch.testing.assert_close(direction(roma.quat_action(turn, eta)), direction(omega), atol=1e-6, rtol=0)
    torch.testing.assert_close(smallest_turn(eta, omega), turn, atol=0, rtol=0)


def test_no_length_asks_for_no_turn_and_batches_broadcast():
    turns = smallest_turn(torch.zeros(3), torch.randn(2, 5, 3))
    torch.testing.assert_close(turns, torch.tensor([0.0, 0, 0, 1]).expand(2, 5, 4))


def motion(frames: int = 12) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    heads, rotations = (torch.from_numpy(each) for each in swinging(np.random.default_rng(0), frames))
    tails = torch.from_numpy(TAILS)
    offsets = torch.cat([torch.zeros(1, 3), tails[torch.as_tensor(PARENTS[1:], dtype=torch.long)]])
    offsets[8] = torch.tensor([0.1, -0.05, 0.02])  # a hip that hangs from no tail
    return joint_positions(rotations, heads[:, 0], offsets, PARENTS), rotations, tails, offsets


def moves(tails: torch.Tensor, spread_m: float, seed: int) -> torch.Tensor:
    """Random moves of tails and of heads, (2, ..., J, 3)."""
    return spread_m * torch.randn(2, *tails.shape, generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("seed", range(3))
def test_another_rest_pose_of_the_same_lengths_changes_no_position_and_no_foq(seed: int):
    heads, rotations, tails, offsets = motion()
    generator = torch.Generator().manual_seed(seed)
    turned = torch.randn(tails.shape, generator=generator)
    new_tails = direction(turned) * tails.norm(dim=-1, keepdim=True)
    new_offsets = carried_offsets(offsets, tails, new_tails, PARENTS)
    new_heads, new_rotations = realign(heads, rotations, tails, new_offsets, new_tails, PARENTS)
    torch.testing.assert_close(new_heads, heads, atol=1e-5, rtol=0)
    # Each bone of the random new rest pose points where the old one did, though its frame is another.
    torch.testing.assert_close(
        roma.quat_action(new_rotations, new_tails.expand_as(heads)),
        roma.quat_action(rotations, tails.expand_as(heads)), atol=1e-5, rtol=0,
    )  # fmt: skip
    torch.testing.assert_close(
        joint_positions(new_rotations, heads[:, 0], new_offsets, PARENTS), heads, atol=1e-5, rtol=0
    )
    torch.testing.assert_close(first_frame_offsets(new_rotations), first_frame_offsets(rotations), atol=1e-5, rtol=0)
    assert (new_rotations * rotations).sum(-1).abs().min() < 0.99


def test_a_random_rest_pose_moves_joints_a_little_and_bones_still_aim_at_their_old_tails():
    heads, rotations, tails, offsets = motion()
    new_offsets, new_tails = moved_rest_pose(offsets, tails, PARENTS, *moves(tails, 0.03, 1))
    new_heads, new_rotations = realign(heads, rotations, tails, new_offsets, new_tails, PARENTS)
    torch.testing.assert_close(
        joint_positions(new_rotations, heads[:, 0], new_offsets, PARENTS), new_heads, atol=1e-5, rtol=0
    )
    aims = heads + roma.quat_action(rotations, tails.expand_as(heads)) - new_heads
    pointing = roma.quat_action(new_rotations, new_tails.expand_as(heads))
    torch.testing.assert_close(direction(pointing), direction(aims), atol=1e-5, rtol=0)
    moved = (new_heads - heads).norm(dim=-1).mean()
    assert 0.005 < moved < 0.1
    # It is more than another frame for each bone: the turns differ from frame to frame.
    assert (first_frame_offsets(new_rotations) - first_frame_offsets(rotations)).abs().max() > 0.01


def test_no_move_changes_nothing_and_windows_have_rest_poses_of_their_own():
    heads, rotations, tails, offsets = motion()
    same = moved_rest_pose(offsets, tails, PARENTS, *moves(tails, 0.0, 1))
    torch.testing.assert_close(same[0], offsets)
    torch.testing.assert_close(same[1], tails)
    batch = [each.expand(2, *each.shape) for each in (heads, rotations, tails, offsets)]
    new_offsets, new_tails = moved_rest_pose(batch[3], batch[2], PARENTS, *moves(batch[2], 0.05, 2))
    both = realign(batch[0], batch[1], batch[2], new_offsets, new_tails, PARENTS)
    for row in range(2):
        alone = realign(heads, rotations, tails, new_offsets[row], new_tails[row], PARENTS)
        torch.testing.assert_close(both[0][row], alone[0])
        torch.testing.assert_close(both[1][row], alone[1])
