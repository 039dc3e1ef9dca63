"""Drawn points: on a skeleton, scattered wider, on another body, and as `tpc` artefacts are read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from data_schemas.tpc import place_points as stored_points
from stages.shared.pointcloud.bones import bone_set
from stages.shared.pointcloud.drawn_points import DrawnPoints, draw_on_skeleton, spread_on_skeleton
from tests.shared.inference.examples import humanoid


def some_transforms(bones: int, frames: int = 6) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    heads = torch.randn(frames, bones, 3, generator=generator)
    return heads, torch.nn.functional.normalize(torch.randn(frames, bones, 4, generator=generator), dim=-1)


def test_equation_3_is_the_same_where_clouds_are_read_and_where_they_are_drawn() -> None:
    """PC-MRL eq. 3 stands twice: `data_schemas` reads clouds without torch, everything else is torch."""
    stored, _ = bone_set(humanoid(), 80, seed=1)
    heads, rotations = some_transforms(len(stored.parents))
    bones, alphas, offsets, tails = (
        torch.from_numpy(part)
        for part in (stored.point_bones, stored.point_alphas, stored.point_offsets, stored.tails)
    )
    groups = torch.from_numpy(stored.groups[stored.point_bones]).long()
    placed = DrawnPoints(bones, alphas, offsets, groups, tails, 0.06).place(heads, rotations)
    expected = stored_points(stored, heads.numpy(), rotations.numpy(), 0.06)
    np.testing.assert_allclose(placed.numpy(), expected, atol=2e-6)


def test_points_lie_on_sampled_bones_of_their_groups() -> None:
    skeleton = humanoid()
    for drawn in (
        draw_on_skeleton(skeleton, 64, np.random.default_rng(0), 0.05),
        spread_on_skeleton(skeleton, 64, 0.25, 0.05),
    ):
        assert skeleton.sampled[drawn.bones.numpy()].all()
        assert (drawn.groups.numpy() == skeleton.groups[drawn.bones.numpy()]).all()


def test_the_same_draw_is_scattered_wider_or_put_on_a_larger_body() -> None:
    skeleton = humanoid()
    drawn = draw_on_skeleton(skeleton, 64, np.random.default_rng(0), 0.05)
    on_bones = replace(drawn, sigma_m=0.0)
    wider = replace(drawn, sigma_m=0.1)
    torch.testing.assert_close(wider.in_bone - on_bones.in_bone, 2 * (drawn.in_bone - on_bones.in_bone))
    torch.testing.assert_close(replace(on_bones, tails=2 * drawn.tails).in_bone, 2 * on_bones.in_bone)
