"""The solve's sums over points, which two products make, against the sums written out."""

import numpy as np
import pytest
import torch

from stages.shared.solve.binding import Binding
from stages.shared.solve.solve_equations import Pose, SolveOptions, base_of, build_chain, forward, linearise

PARENTS = np.array([-1, 0, 1, 1, 0, 4])


def scene(seed: int, points: int = 40, frames: int = 5):
    """A chain, its base and a pose near it, and the points' targets."""
    generator = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=generator)

    joints = torch.randint(0, len(PARENTS), (points,), generator=generator)
    weights = torch.rand(points, generator=generator)
    binding = Binding(joints, 0.1 * normal(points, 3), weights, torch.zeros(points))
    local = torch.nn.functional.normalize(torch.tensor([0.0, 0.0, 0.0, 1.0]) + 0.3 * normal(frames, 6, 4), dim=-1)
    options = SolveOptions()
    chain = build_chain(binding, PARENTS, 0, options)
    base = base_of(chain, local, 30 * normal(frames, 3), 0.3 * normal(6, 3), PARENTS, 0)
    pose = Pose(base.local, base.root + 0.01 * normal(frames, 3))
    rotations, heads = forward(pose, chain, base)
    places = heads[:, chain.bones] + (rotations[:, chain.bones] @ chain.in_bone.unsqueeze(-1)).squeeze(-1)
    targets = places + 0.08 * normal(frames, points, 3)
    return targets, places, chain, base, pose, options


@pytest.mark.parametrize("seed", [0, 1])
def test_the_equations_are_those_of_the_points_written_out(seed: int):
    targets, places, chain, base, pose, options = scene(seed)
    made = linearise(targets, pose, chain, base, options)
    targets, places = targets.double(), places.double()
    rotations, heads = (part.double() for part in forward(pose, chain, base))
    # Slopes of every point: it moves with the shift, and about the head of every joint above it, in the joint's axes.
    slopes = torch.zeros(*places.shape, 3 + 3 * len(chain.joints), dtype=torch.float64)
    slopes[..., :3] = torch.eye(3)
    for joint in range(len(chain.joints)):
        arms = places - heads[:, joint, None]
        turning = torch.linalg.cross(rotations[:, None, joint].transpose(-1, -2), arms.unsqueeze(-2), dim=-1)
        above = (chain.below[joint] @ chain.riding > 0).double()
        slopes[..., 3 + 3 * joint : 6 + 3 * joint] = turning.transpose(-1, -2) * above[:, None, None]
    misses = targets - places
    distance = misses.norm(dim=-1)
    weights = chain.weights * (options.huber_m / distance.clamp(min=options.huber_m))
    matrix = torch.einsum("tpcu,tp,tpcv->tuv", slopes, weights, slopes) + chain.prior_matrix
    shifted = torch.zeros(len(targets), slopes.shape[-1], dtype=torch.float64)
    shifted[:, :3] = (pose.root - base.root) * options.shift_prior_m**-2
    pull = torch.einsum("tpcu,tp,tpc->tu", slopes, weights, misses) - shifted
    for found, expected in ((made.matrix, matrix), (made.pull, pull)):
        assert (found - expected).abs().max() < 1e-4 * expected.abs().max()
    wanted = ((weights * distance**2).sum(-1) / weights.sum(-1)).sqrt()
    torch.testing.assert_close(made.residual.double(), wanted, atol=1e-5, rtol=1e-4)
