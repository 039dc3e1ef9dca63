"""Borrowed parts: joints turn as in the lender; the root, the legs and the lengths of bones stay."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from data_schemas.tpc import TpcReader
from stages.shared.kinematics.window_hierarchy import in_parents
from stages.shared.training.borrowed_parts import with_borrowed_parts
from stages.shared.training.task import step_random
from stages.shared.training.windows import WindowPool, Windows
from tests.shared.training.tiny_clouds import GROUPS, write_clouds

ARMS, LEGS = (torch.from_numpy(np.isin(GROUPS, sides)) for sides in ((1, 2), (3, 4)))
ROOT = torch.arange(len(GROUPS)) == 0


@pytest.fixture(scope="module")
def pool(tmp_path_factory):
    with TpcReader(write_clouds(tmp_path_factory.mktemp("clouds") / "tpc")) as reader:
        yield WindowPool(reader, ("train",))


@pytest.fixture(scope="module")
def pair(pool) -> tuple[Windows, Windows]:
    """Ten windows and ten others, all of one skeleton."""
    own, others = (pool.draw(10, 20, np.random.default_rng(seed), augment=False) for seed in (1, 2))
    assert torch.equal(own.tails, others.tails)
    return own, others


def _turns(windows: Windows) -> torch.Tensor:
    """(B, T, J, 4) at the parents, with w not negative."""
    frames = windows.heads.shape[1]
    parents = windows.parents.repeat_interleave(frames, 0)
    local = in_parents(windows.heads.flatten(0, 1), windows.rotations.flatten(0, 1), parents)[0]
    return (local * local[..., 3:].sign()).unflatten(0, (-1, frames))


def _lengths(windows: Windows) -> torch.Tensor:
    parents = windows.parents[0].clamp_min(0)
    return (windows.heads - windows.heads[:, :, parents]).norm(dim=-1)


@pytest.mark.parametrize("arms_alone", [True, False])
def test_borrowed_joints_turn_as_in_the_lender_and_all_others_as_before(pair, arms_alone):
    own, others = pair
    mixed = with_borrowed_parts(own, others, np.full(10, arms_alone))
    taken = ARMS if arms_alone else ~LEGS
    taken = taken & ~ROOT
    torch.testing.assert_close(_turns(mixed)[:, :, taken], _turns(others)[:, :, taken], atol=1e-5, rtol=0)
    torch.testing.assert_close(_turns(mixed)[:, :, ~taken], _turns(own)[:, :, ~taken], atol=1e-5, rtol=0)
    torch.testing.assert_close(_lengths(mixed), _lengths(own), atol=1e-5, rtol=0)
    assert torch.equal(mixed.heads[:, :, LEGS], own.heads[:, :, LEGS])  # to the bit
    assert torch.equal(mixed.heads[:, :, 0], own.heads[:, :, 0])
    assert not torch.allclose(mixed.heads[:, :, ARMS], own.heads[:, :, ARMS], atol=0.01)


def test_a_window_borrows_from_itself_without_change(pair):
    own, _ = pair
    mixed = with_borrowed_parts(own, own, np.arange(10) % 2 == 0)
    torch.testing.assert_close(mixed.heads, own.heads, atol=1e-5, rtol=0)


def test_a_bone_of_the_spine_that_carries_a_leg_stays(pair):
    own, others = pair
    leg = int(np.flatnonzero(LEGS)[0])
    spine = int(np.flatnonzero((GROUPS == 0) & ~ROOT.numpy())[0])
    assert spine < leg
    for windows in (own, others):
        windows.parents = windows.parents.clone()
        windows.parents[:, leg] = spine
    mixed = with_borrowed_parts(own, others, np.zeros(10, bool))
    assert torch.equal(mixed.rotations[:, :, spine], own.rotations[:, :, spine])
    assert torch.equal(mixed.heads[:, :, leg], own.heads[:, :, leg])


def test_the_share_of_windows_that_borrow_and_their_independence_of_the_batch(pool):
    rows = range(200)
    plain = pool.draw(200, 12, step_random(0, 1, 3, rows), augment=True)
    drawn = pool.draw(200, 12, step_random(0, 1, 3, rows), augment=True, borrowed_share=0.3)
    other = (drawn.heads != plain.heads).flatten(1).any(1)
    assert 0.2 < float(other.float().mean()) < 0.4
    part = pool.draw(3, 12, step_random(0, 1, 3, (7, 50, 120)), augment=True, borrowed_share=0.3)
    assert torch.equal(part.heads, drawn.heads[[7, 50, 120]])
