"""The solve against a slow plain reference (autograd), and what it must do with bad evidence."""

from __future__ import annotations

import numpy as np
import pytest
import roma
import torch

from stages.shared.inference.clouds import place_on_pose
from stages.shared.pointcloud.drawn_points import draw_on_skeleton
from stages.shared.solve.binding import Binding, bind_points, carry_points
from stages.shared.solve.skeleton_pose import SkeletonPose, pose_of_motion
from stages.shared.solve.solve_equations import Pose, base_of, build_chain, linearise
from stages.shared.solve.solving import SolveOptions, solve_pose
from tests.shared.inference.examples import humanoid, swinging

OPTIONS = SolveOptions(point_noise_m=0.02, huber_m=0.05, turn_prior_rad=0.5, shift_prior_m=0.3)


def scene(frames: int = 6, above: bool = False, points: int = 64):
    skeleton = humanoid(above=above)
    motion = swinging(skeleton, frames)
    pose = pose_of_motion(skeleton, motion)
    drawn = draw_on_skeleton(skeleton, points, np.random.default_rng(0), 0.05)
    binding = Binding(drawn.bones.long(), drawn.in_bone, torch.ones(points), torch.zeros(points))
    return skeleton, motion, pose, drawn, binding


def shaken(pose: SkeletonPose, size: float, seed: int = 1) -> SkeletonPose:
    generator = torch.Generator().manual_seed(seed)
    turns = size * torch.randn(*pose.local.shape[:2], 3, generator=generator)
    shifts = size * torch.randn(len(pose.roots), 3, generator=generator)
    turns[:, : pose.skeleton.root] = 0
    return pose.corrected(turns, shifts)


def cost_of(steps, targets, skeleton, binding, base: SkeletonPose, chain, pose: Pose):
    """The objective in plain words, for one frame: steps (3 + 3A,) on top of `pose`."""
    turns = torch.zeros(1, skeleton.joints, 3, dtype=torch.float64)
    local = torch.zeros(skeleton.joints, 3, dtype=torch.float64)
    for row, joint in enumerate(chain.joints.tolist()):
        now = turned_from_base(base, joint, pose, row)
        local[joint] = roma.rotmat_to_rotvec(now @ roma.rotvec_to_rotmat(steps[3 + 3 * row : 6 + 3 * row]))
    turns[0] = local
    heads0, _ = base.world()
    shift = pose.root[0].double() + steps[:3] - heads0[0, skeleton.root]
    full = base.with_local(*(part.double() for part in base.parts))
    moved = full.corrected(turns, shift[None])
    heads, rotations = moved.world()
    tied = Binding(binding.joints, binding.in_bone.double(), binding.weights, binding.wander)
    points = carry_points(tied, heads, rotations)
    distance = (targets.double() - points[0]).norm(dim=-1)
    near = distance.clamp(max=OPTIONS.huber_m)
    fit = (chain.weights.double() * near * (distance - near / 2)).sum()
    prior = turns.square().sum() / OPTIONS.turn_prior_rad**2 + shift.square().sum() / OPTIONS.shift_prior_m**2
    return fit + prior / 2


def turned_from_base(base: SkeletonPose, joint: int, pose: Pose, row: int) -> torch.Tensor:
    """Rotation of a joint in `pose` after the base's, (3, 3) float64. Row 0, the pelvis, is global in the pose."""
    if row == 0:
        _, rotations = base.world()
        start = roma.unitquat_to_rotmat(rotations[0, joint]).double()
    else:
        start = roma.unitquat_to_rotmat(base.local[0, joint]).double()
    return start.T @ pose.local[0, row].double()


@pytest.mark.parametrize("above", [False, True])
@pytest.mark.parametrize("size", [0.0, 0.15])
def test_gradient_is_autograds(above: bool, size: float):
    skeleton, _, pose, drawn, binding = scene(1, above, points=24)
    base = shaken(pose, 0.2)
    targets = place_on_pose(drawn, pose, skeleton)
    chain = build_chain(binding, skeleton.parents, skeleton.root, OPTIONS)
    start = base_of(chain, *base.parts, skeleton.parents, skeleton.root)
    generator = torch.Generator().manual_seed(5)
    wiggle = roma.rotvec_to_rotmat(size * torch.randn(1, len(chain.joints), 3, generator=generator))
    at = Pose(start.local @ wiggle, start.root + size * torch.randn(1, 3, generator=generator))
    system = linearise(targets, at, chain, start, OPTIONS)
    steps = torch.zeros(3 + 3 * len(chain.joints), dtype=torch.float64, requires_grad=True)
    cost = cost_of(steps, targets[0], skeleton, binding, base, chain, at)
    (gradient,) = torch.autograd.grad(cost, steps)
    assert float(system.cost[0]) == pytest.approx(float(cost.detach()), rel=1e-4)
    torch.testing.assert_close(system.pull[0].double(), -gradient, rtol=2e-3, atol=2e-3 * float(gradient.abs().max()))


def test_normal_matrix_is_the_jacobians():
    """Without robust weights the points' part is J'WJ, with J by finite differences of plain kinematics."""
    skeleton, _, pose, drawn, binding = scene(1, points=24)
    options = SolveOptions(huber_m=1e3)
    chain = build_chain(binding, skeleton.parents, 0, options)
    base = base_of(chain, *pose.parts, skeleton.parents, 0)
    at = Pose(base.local, base.root)
    system = linearise(place_on_pose(drawn, pose, skeleton), at, chain, base, options)
    double = pose.with_local(*(part.double() for part in pose.parts))
    size = 3 + 3 * len(chain.joints)

    def points(steps: torch.Tensor) -> torch.Tensor:
        turns = torch.zeros(1, skeleton.joints, 3, dtype=torch.float64)
        turns[0, chain.joints] = steps[3:].view(-1, 3)
        moved = double.corrected(turns, steps[None, :3])
        tied = Binding(binding.joints, binding.in_bone.double(), binding.weights, binding.wander)
        return carry_points(tied, *moved.world()).flatten()

    eye = torch.eye(size, dtype=torch.float64) * 1e-5
    jacobian = torch.stack([(points(step) - points(-step)) / 2e-5 for step in eye], -1)
    weights = chain.weights.double().repeat_interleave(3)
    expected = jacobian.T @ (weights[:, None] * jacobian)
    prior = torch.full((size,), options.turn_prior_rad**-2, dtype=torch.float64)
    prior[:3] = options.shift_prior_m**-2
    torch.testing.assert_close(system.matrix[0].double(), expected + torch.diag(prior), rtol=1e-3, atol=1.0)


@pytest.mark.parametrize("above", [False, True])
def test_finds_the_pose(above: bool):
    skeleton, _, pose, drawn, binding = scene(20, above, points=256)
    base = shaken(pose, 0.25)
    targets = place_on_pose(drawn, pose, skeleton)
    options = SolveOptions(point_noise_m=0.002, iterations=15)
    found = solve_pose(targets, binding, *base.parts, skeleton.parents, skeleton.root, options)
    fixed = base.corrected(found.turns, found.shifts)
    truth, heads = pose.heads, fixed.heads
    before = (base.heads - truth).norm(dim=-1).mean()
    body = torch.as_tensor(skeleton.groups >= 0)
    assert float((heads - truth)[:, body].norm(dim=-1).max()) < 0.02
    assert float((heads - truth)[:, body].norm(dim=-1).mean()) < 0.02 * float(before)
    finger = skeleton.names.index("left_finger")
    assert not found.seen[finger] and not found.seen[: skeleton.root].any() and found.seen.sum() == 11
    assert (found.turns[:, finger] == 0).all()


def test_no_evidence_leaves_the_base():
    skeleton, _, pose, drawn, binding = scene(3)
    targets = place_on_pose(drawn, shaken(pose, 0.3), skeleton)
    silent = Binding(binding.joints, binding.in_bone, torch.zeros_like(binding.weights), binding.wander)
    found = solve_pose(targets, silent, *pose.parts, skeleton.parents, 0, OPTIONS)
    assert float(found.turns.abs().max()) < 1e-6 and float(found.shifts.abs().max()) < 1e-6


def test_stray_points_do_not_pull_a_limb_away():
    skeleton, _, pose, drawn, binding = scene(5, points=256)
    targets = place_on_pose(drawn, pose, skeleton)
    targets[:, ::10] += torch.tensor([3.0, -2.0, 1.0])
    found = solve_pose(targets, binding, *pose.parts, skeleton.parents, 0, SolveOptions())
    moved = pose.corrected(found.turns, found.shifts).heads
    assert float((moved - pose.heads).norm(dim=-1).mean()) < 0.03


def test_frames_do_not_touch_each_other_and_far_from_the_origin_is_as_good():
    skeleton, _, pose, drawn, binding = scene(7, points=128)
    base = shaken(pose, 0.1)
    targets = place_on_pose(drawn, pose, skeleton)
    whole = solve_pose(targets, binding, *base.parts, skeleton.parents, 0, OPTIONS)
    one = solve_pose(targets[3:4], binding, *base.rows(slice(3, 4)).parts, skeleton.parents, 0, OPTIONS)
    torch.testing.assert_close(whole.turns[3:4], one.turns, atol=2e-3, rtol=0)
    far = torch.tensor([1000.0, 0.0, -500.0])
    moved = base.with_local(base.local, base.roots + far, base.offsets)
    away = solve_pose(targets + far, binding, *moved.parts, skeleton.parents, 0, OPTIONS)
    torch.testing.assert_close(whole.turns, away.turns, atol=5e-3, rtol=0)


def test_binding_finds_the_bones_from_positions_and_groups():
    skeleton, _, pose, drawn, _ = scene(8, points=256)
    points = place_on_pose(drawn, pose, skeleton)
    heads, rotations = pose.world()
    found = bind_points(points, drawn.groups, skeleton, heads, rotations)
    assert float((found.joints == drawn.bones).float().mean()) > 0.99
    right = found.joints == drawn.bones
    torch.testing.assert_close(found.in_bone[right], drawn.in_bone[right], atol=1e-4, rtol=0)
    assert float(found.wander[right].max()) < 1e-3
    order = torch.randperm(256, generator=torch.Generator().manual_seed(0))
    shuffled = bind_points(points[:, order], drawn.groups[order], skeleton, heads, rotations)
    assert (shuffled.joints == found.joints[order]).all()


def test_points_of_a_group_without_bones_say_nothing():
    skeleton, _, pose, drawn, _ = scene(4)
    heads, rotations = pose.world()
    points = place_on_pose(drawn, pose, skeleton)
    armless = humanoid()
    armless.sampled[armless.groups == 1] = False
    found = bind_points(points, drawn.groups, armless, heads, rotations)
    assert (found.weights[drawn.groups == 1] == 0).all() and (found.weights[drawn.groups != 1] > 0).all()
