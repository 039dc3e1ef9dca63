"""Pose vectors: there and back, and what they do not depend on."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from stages.shared.networks.inbetween.pose_space import PoseSpace
from tests.shared.training.tiny_clouds import GROUPS, PARENTS, swinging

FRAMES = 31
KNOWN = (torch.arange(FRAMES) % 10 == 0).expand(2, -1)


def bones(seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    rng = np.random.default_rng(seed)
    parts = [swinging(rng, FRAMES) for _ in range(2)]
    heads, rotations = (torch.from_numpy(np.stack(part)).double() for part in zip(*parts, strict=True))
    return heads, torch.nn.functional.normalize(rotations, dim=-1)


def space(heads: torch.Tensor, rotations: torch.Tensor) -> PoseSpace:
    made = PoseSpace(PARENTS.tolist(), GROUPS.tolist()).double()
    placed = made.placement(heads, KNOWN)
    made.set_statistics(made.vectors(heads, rotations, placed).flatten(0, 1))
    return made


@pytest.mark.parametrize("seed", range(3))
def test_there_and_back(seed: int):
    heads, rotations = bones(seed)
    made = space(heads, rotations)
    placed = made.placement(heads, KNOWN)
    vectors = made.vectors(heads, rotations, placed)
    found = made.joints(vectors, made.offsets(heads, rotations), placed)
    torch.testing.assert_close(found[0], heads, atol=1e-5, rtol=0)  # heads are stored as float32
    same = (found[1] * rotations).sum(-1).abs()
    torch.testing.assert_close(same, torch.ones_like(same), atol=1e-6, rtol=0)
    assert vectors.flatten(0, 1).mean(0).abs().max() < 1e-9
    again = made.with_local(vectors, made.local(vectors))
    torch.testing.assert_close(again, vectors, atol=1e-5, rtol=0)


def test_local_rotations_agree_with_scipy():
    heads, rotations = bones()
    made = space(heads, rotations)
    vectors = made.vectors(heads, rotations, made.placement(heads, KNOWN))
    local = made.local(vectors)[1, 7]
    for bone in range(1, len(PARENTS)):
        above, own = (Rotation.from_quat(rotations[1, 7, j].numpy()) for j in (PARENTS[bone], bone))
        assert (above.inv() * own * Rotation.from_quat(local[bone].numpy()).inv()).magnitude() < 1e-5


def test_where_a_window_is_and_which_way_it_faces_mean_nothing():
    heads, rotations = bones()
    made = space(heads, rotations)
    vectors = made.vectors(heads, rotations, made.placement(heads, KNOWN))
    yaw = Rotation.from_rotvec([0, 1.9, 0])
    moved = torch.from_numpy(yaw.apply(heads.reshape(-1, 3)).reshape(heads.shape) + np.array([3.0, 0, -2.0]))
    turned = torch.from_numpy((yaw * Rotation.from_quat(rotations.reshape(-1, 4))).as_quat()).view_as(rotations)
    other = made.vectors(moved, turned, made.placement(moved, KNOWN))
    torch.testing.assert_close(other, vectors, atol=1e-6, rtol=0)


def test_the_placement_is_found_from_known_frames_alone_for_the_ground():
    heads, rotations = bones()
    made = space(heads, rotations)
    origin = made.placement(heads, KNOWN).origin
    expected = heads[:, ::10, 0].mean(1) * torch.tensor([1.0, 0, 1.0])
    torch.testing.assert_close(origin, expected)
