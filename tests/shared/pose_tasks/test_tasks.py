"""Poses of a rig's body and the tasks on them: round trips, batches that split, a base that no network changes."""

from __future__ import annotations

import numpy as np
import pytest
import roma
import torch

from data_schemas.errors import UsageError
from stages.shared.kinematics.matrix_poses import columns_of, rotations_of_columns
from stages.shared.pointcloud.rig import rig_of_motion
from stages.shared.pose_tasks.body_pose import BodyPose, outputs_of, placing_of, pose_of_outputs
from stages.shared.pose_tasks.pose_network import SIZES, PoseNetwork
from stages.shared.pose_tasks.registry import task_named
from stages.shared.solve.skeleton_pose import SkeletonPose
from tests.shared.inference.examples import humanoid, swinging

SKELETON = humanoid()
RIG = rig_of_motion(SKELETON, swinging(SKELETON, 60))
OWN = ("denoise", "repair", "trackers")
PUMPS = {
    "latent_width": 16,
    "synthesiser": {"width": 24, "heads": 2, "key_layers": 1, "fill_layers": 1, "frame_layers": 1},
}


def windows(count: int = 3, frames: int = 40) -> BodyPose:
    poses = [SkeletonPose.of_motion(SKELETON, swinging(SKELETON, frames, seed=seed)) for seed in range(count)]
    joints = torch.as_tensor(RIG.body.joints)
    return BodyPose(
        torch.stack([pose.heads[:, SKELETON.root] for pose in poses]),
        torch.stack([pose.rotations[:, joints] for pose in poses]),
    )


def generators(rows: range) -> list[np.random.Generator]:
    return [np.random.default_rng((4, row)) for row in rows]


def test_placing_is_undone_and_makes_windows_face_one_way():
    pose, given = windows(), torch.ones(3, 40, dtype=torch.bool)
    yaw, centre = placing_of(pose, RIG.body, given)
    placed = pose.placed(yaw, centre)
    again, _ = placing_of(placed, RIG.body, given)
    torch.testing.assert_close(again, torch.zeros(3), atol=1e-4, rtol=0)
    torch.testing.assert_close(placed.roots.mean(1), torch.zeros(3, 3), atol=1e-5, rtol=0)
    back = placed.back(yaw, centre)
    torch.testing.assert_close(back.roots, pose.roots, atol=1e-5, rtol=0)
    torch.testing.assert_close(
        (back.rotations * pose.rotations).sum(-1).abs(), torch.ones(3, 40, 11), atol=1e-5, rtol=0
    )


def test_columns_are_those_of_another_library_and_come_back():
    rotations = windows().rotations.reshape(-1, 4)
    matrix = roma.unitquat_to_rotmat(rotations)
    expected = torch.cat([matrix[..., 0], matrix[..., 1]], dim=-1)
    torch.testing.assert_close(columns_of(rotations), expected, atol=1e-5, rtol=0)
    scaled = 2.5 * columns_of(rotations)
    same = (rotations_of_columns(scaled) * rotations).sum(-1).abs()
    torch.testing.assert_close(same, torch.ones_like(same), atol=1e-5, rtol=0)


def test_outputs_of_zero_give_the_base_and_others_have_gradients():
    base = windows()
    outputs = torch.zeros(3, 40, outputs_of(RIG.body), requires_grad=True)
    made = pose_of_outputs(outputs, base)
    torch.testing.assert_close(made.roots, base.roots)
    made.heads(RIG.body).square().sum().backward()
    assert (
        outputs.grad is not None and bool(torch.isfinite(outputs.grad).all()) and float(outputs.grad.abs().sum()) > 0
    )


@pytest.mark.parametrize("name", OWN)
def test_a_part_of_a_batch_is_that_part(name: str):
    valid = torch.ones(3, 40, dtype=torch.bool)
    for corruption in task_named(name, RIG).corruptions:
        task = task_named(name, RIG, corruption)
        whole = task.draw(windows(), valid, generators(range(3)))
        clean = BodyPose(windows().roots[1:], windows().rotations[1:])
        part = task.draw(clean, valid[1:], generators(range(1, 3)))
        torch.testing.assert_close(part.features, whole.features[1:], atol=1e-5, rtol=0)
        assert whole.features.shape == (3, 40, task.features) and bool(torch.isfinite(whole.features).all())
        figures = task.measures(whole.target, whole)
        assert figures["mpjpe_mm"] < 0.05
        # A joint that is frozen or lost may be mended to the last tenth of a millimetre.
        assert name == "repair" or task.measures(whole.base, whole)["mpjpe_mm"] > 0.05


@pytest.mark.parametrize("name", OWN)
def test_where_a_motion_is_and_which_way_it_faces_mean_nothing(name: str):
    valid, pose = torch.ones(3, 40, dtype=torch.bool), windows()
    task = task_named(name, RIG)
    yaw, centre = torch.tensor([0.4, 2.0, -1.0]), torch.tensor([[1.0, 0.0, -2.0]]).expand(3, 3)
    plain, moved = (task.draw(each, valid, generators(range(3))) for each in (pose, pose.placed(yaw, centre)))
    if name == "trackers":  # the other tasks' noise is not turned with the motion
        torch.testing.assert_close(moved.features, plain.features, atol=1e-3, rtol=0)
    torch.testing.assert_close(
        moved.target.heads(RIG.body).mean(), plain.target.heads(RIG.body).mean(), atol=0.1, rtol=0
    )


def test_repair_starts_nearer_to_the_truth_than_denoise():
    valid = torch.ones(3, 40, dtype=torch.bool)
    found = []
    for name in ("denoise", "repair"):
        task = task_named(name, RIG)
        batch = task.draw(windows(), valid, generators(range(3)))
        found.append(task.measures(batch.base, batch)["mpjpe_mm"])
    assert found[1] < 0.5 * found[0]


@pytest.mark.parametrize("kind", ["pumps", "transformer", "u-vit"])
def test_an_untrained_network_returns_the_base(kind: str):
    task, valid = task_named("denoise", RIG), torch.ones(3, 40, dtype=torch.bool)
    batch = task.draw(windows(), valid, generators(range(3)))
    settings = PUMPS if kind == "pumps" else {**SIZES[kind], "width": 24, "heads": 2, "layers": 3}
    network = PoseNetwork(kind, task.features, outputs_of(RIG.body), settings)
    network.normalise_by(batch.features, batch.given)
    made = network(batch.features, batch.given, batch.base, torch.arange(40.0).unsqueeze(0), valid)
    torch.testing.assert_close(made.roots, batch.base.roots, atol=1e-5, rtol=0)
    made.roots.sum().backward()
    assert all(p.grad is not None for name, p in network.named_parameters() if ".out." in name or "output" in name)


def test_unknown_names_are_refused_with_those_that_exist():
    with pytest.raises(UsageError, match="juggle") as refused:
        task_named("juggle", RIG)
    assert "denoise" in str(refused.value.hint)
    with pytest.raises(UsageError, match="no corruption 'rain'"):
        task_named("denoise", RIG, "rain")
