"""Work in blocks of frames gives what it gives at once."""

import torch
from hypothesis import given
from hypothesis import strategies as st

from stages.shared.kinematics.frame_blocks import blocks_of, in_blocks
from stages.shared.kinematics.rotations import from_turn_vectors, multiply


@given(st.integers(0, 40), st.integers(1, 12))
def test_blocks_cover_every_frame_once_and_in_order(frames: int, most: int):
    slices = list(blocks_of(frames, most))
    assert [frame for rows in slices for frame in range(frames)[rows]] == list(range(frames))
    assert all(0 < rows.stop - rows.start <= most for rows in slices)


@given(st.integers(1, 40), st.integers(1, 12), st.integers(0, 1000))
def test_blocks_give_the_same_bytes(frames: int, most: int, seed: int):
    draw = torch.Generator().manual_seed(seed)
    turns, rotations = torch.randn(frames, 3, 3, generator=draw), torch.randn(frames, 3, 4, generator=draw)

    def turned(turns: torch.Tensor, rotations: torch.Tensor) -> torch.Tensor:
        return multiply(from_turn_vectors(turns), rotations)

    assert torch.equal(in_blocks(turned, turns, rotations, most=most), turned(turns, rotations))


def test_gradients_pass_through_blocks():
    values = torch.arange(6.0, requires_grad=True)
    in_blocks(torch.square, values, most=4).sum().backward()
    assert values.grad is not None and torch.equal(values.grad, 2 * values.detach())
