"""Other builds of a body: rotations stay, bones stay rigid, left and right stay alike, paths grow with the legs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from data_schemas.tpc import TpcReader
from stages.shared.training.proportions import with_other_proportions
from stages.shared.training.task import step_random
from stages.shared.training.windows import WindowPool, Windows
from tests.shared.training.tiny_clouds import GROUPS, PARENTS, write_clouds

MOST = 1.15


@pytest.fixture(scope="module")
def windows(tmp_path_factory) -> Windows:
    with TpcReader(write_clouds(tmp_path_factory.mktemp("clouds") / "tpc")) as reader:
        return WindowPool(reader, ("train",)).draw(6, 20, np.random.default_rng(2), augment=False)


@pytest.fixture(scope="module")
def changed(windows) -> Windows:
    return with_other_proportions(windows, MOST, np.random.default_rng(1))


def _ways(windows: Windows) -> torch.Tensor:
    """(B, T, J - 1) from every bone but the root to its parent."""
    return (windows.heads[:, :, 1:] - windows.heads[:, :, PARENTS[1:]]).norm(dim=-1)


def test_turns_stay_and_ways_scale_alike_in_all_frames(windows, changed):
    assert torch.equal(changed.rotations, windows.rotations) and torch.equal(changed.valid, windows.valid)
    ratio = _ways(changed) / _ways(windows)
    assert torch.allclose(ratio, ratio[:, :1], atol=1e-4)  # rigid
    assert float(ratio.max()) <= MOST + 1e-4 and float(ratio.min()) >= 1 / MOST - 1e-4
    assert float(ratio.std(0).mean()) > 0.02  # each window has a build of its own
    along = (changed.heads[:, :, 1:] - changed.heads[:, :, PARENTS[1:]]) / ratio.unsqueeze(-1)
    assert torch.allclose(along, windows.heads[:, :, 1:] - windows.heads[:, :, PARENTS[1:]], atol=1e-5)


def test_tails_and_weights_grow_with_what_hangs_on_them(windows, changed):
    tails = changed.tails.norm(dim=-1) / windows.tails.norm(dim=-1)
    hung = (_ways(changed) / _ways(windows))[:, 0]
    assert torch.allclose(hung, tails[:, PARENTS[1:]], atol=1e-4)
    assert torch.allclose(changed.weights / windows.weights, tails, atol=1e-4)


def test_left_and_right_stay_alike(windows, changed):
    tails = changed.tails.norm(dim=-1) / windows.tails.norm(dim=-1)
    for left, right in ((1, 2), (3, 4)):
        assert torch.allclose(tails[:, left == GROUPS], tails[:, right == GROUPS], atol=1e-5)
    assert not torch.allclose(tails[:, GROUPS == 1], tails[:, GROUPS == 3], atol=1e-3)


def test_the_roots_path_is_scaled_as_the_legs_are(windows, changed):
    legs = GROUPS >= 3
    longer = changed.tails.norm(dim=-1)[:, legs].sum(1) / windows.tails.norm(dim=-1)[:, legs].sum(1)
    assert torch.allclose(changed.heads[:, :, 0], windows.heads[:, :, 0] * longer.view(-1, 1, 1), atol=1e-5)


def test_a_window_has_its_build_whatever_is_drawn_beside_it(windows):
    def built(rows):
        part = replace(windows, **{name: getattr(windows, name)[list(rows)] for name in vars(windows)})
        return with_other_proportions(part, MOST, step_random(0, 1, 5, rows)).heads

    assert torch.equal(built(range(6))[2:4], built(range(2, 4)))


def test_unused_rows_of_smaller_skeletons_stay_where_they_are(windows, changed):
    padded = replace(
        windows,
        heads=torch.cat([windows.heads, torch.zeros(6, 20, 2, 3)], 2),
        rotations=torch.cat([windows.rotations, torch.zeros(6, 20, 2, 4)], 2),
        parents=torch.cat([windows.parents, torch.full((6, 2), -1)], 1),
        tails=torch.cat([windows.tails, torch.zeros(6, 2, 3)], 1),
        groups=torch.cat([windows.groups, torch.zeros(6, 2, dtype=torch.long)], 1),
        weights=torch.cat([windows.weights, torch.zeros(6, 2)], 1),
    )
    made = with_other_proportions(padded, MOST, np.random.default_rng(1))
    assert (made.heads[:, :, 12:] == 0).all() and (made.weights[:, 12:] == 0).all()
    assert torch.isfinite(made.heads).all()
