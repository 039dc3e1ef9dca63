"""Clouds to a rig's motion by a network that was never trained: shapes, windows, refusals."""

import numpy as np
import pytest
import torch

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion
from stages.shared.inference.clouds import place_on_pose
from stages.shared.inference.skeleton_decoding import RigNetwork, decode_cloud, load_rig_network, solve_from_network
from stages.shared.kinematics.forward import positions_of
from stages.shared.pointcloud.drawn_points import DrawnPoints
from stages.shared.solve.skeleton_pose import pose_of_motion
from tests.shared.inference.examples import swinging, write_random_weights
from tests.shared.inference.rig_networks import write_random_rig_network


@pytest.fixture(scope="module")
def network(tmp_path_factory) -> RigNetwork:
    return load_rig_network(write_random_rig_network(tmp_path_factory.mktemp("rig") / "net", above=True), "cpu")


def cloud(frames: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    places = rng.normal(size=(1, 40, 3)) * 0.3
    wave = 0.2 * np.sin(np.arange(frames) / 9)[:, None, None] * rng.normal(size=(1, 40, 3))
    return (places + wave).astype(np.float32), np.arange(40) % 5


@pytest.mark.parametrize("frames", [1, 7, 16, 61])
@pytest.mark.parametrize("decode", [decode_cloud, solve_from_network])
def test_any_length_becomes_a_motion_of_the_rig(network, frames, decode):
    motion = decode(network, *cloud(frames))
    assert motion.frames == frames and motion.rotations.shape[1] == network.rig.skeleton.joints
    assert np.isfinite(motion.rotations).all() and np.isfinite(motion.root_positions).all()
    np.testing.assert_allclose(np.linalg.norm(motion.rotations, axis=-1), 1, atol=1e-5)
    assert ((motion.rotations[1:] * motion.rotations[:-1]).sum(-1) > -1e-6).all()  # no sign jumps
    assert motion.track_joints.tolist() == [1]  # the pelvis moves, what is above it stands


def test_windows_agree_with_one_long_one(network):
    """Frames far from a window's ends, where a network that sees all at once says nearly the same."""
    points, groups = cloud(40)
    pelvis, turns = network.pose(torch.from_numpy(points), torch.from_numpy(groups))
    whole = RigNetwork(**{**vars(network), "window": 40})
    long_pelvis, long_turns = whole.pose(torch.from_numpy(points), torch.from_numpy(groups))
    assert (pelvis - long_pelvis).abs().max() < 0.05
    assert ((turns * long_turns).sum(-1).abs() > 0.98).all()


def test_another_rate_is_another_time(network):
    points, groups = cloud(20)
    motion = decode_cloud(network, points, groups, 60.0)
    assert motion.fps == 60.0
    other = decode_cloud(network, points, groups, 30.0)
    assert not np.allclose(motion.rotations, other.rotations)


def test_the_solve_makes_points_stand_still_in_their_bones(network):
    """True points of a motion, whose pose a network knows up to jitter: the solve removes the jitter."""
    skeleton = network.rig.skeleton
    truth = swinging(skeleton, 40, seed=3)
    rng = np.random.default_rng(0)
    joints = np.flatnonzero(skeleton.sampled)
    bones = rng.choice(joints, 200)
    alphas, offsets = (torch.as_tensor(part).float() for part in (rng.uniform(size=200), rng.normal(size=(200, 3))))
    tails, groups = torch.as_tensor(skeleton.tails).float(), torch.as_tensor(skeleton.groups[bones]).long()
    drawn = DrawnPoints(torch.as_tensor(bones), alphas, offsets, groups, tails, 0.04)
    points = place_on_pose(drawn, pose_of_motion(skeleton, truth), skeleton)

    class Jittering(RigNetwork):
        def pose(self, points, groups, fps=30.0):
            body = self.rig.body
            wrong = torch.from_numpy(truth.rotations[:, body.joints]).clone()
            wrong = wrong + 0.08 * torch.randn(wrong.shape, generator=torch.Generator().manual_seed(0))
            pelvis = torch.from_numpy(positions_of(skeleton, truth)[:, skeleton.root])
            return pelvis, wrong / wrong.norm(dim=-1, keepdim=True)

    jittering = Jittering(**vars(network))

    def error(motion: Motion) -> float:
        apart = positions_of(skeleton, motion)[:, joints] - positions_of(skeleton, truth)[:, joints]
        return float(np.linalg.norm(apart, axis=-1).mean())

    raw = error(decode_cloud(jittering, points, drawn.groups))
    solved = error(solve_from_network(jittering, points, drawn.groups))
    assert raw > 0.02 and solved < 0.5 * raw


@pytest.mark.parametrize(
    ("points", "groups"),
    [
        (np.zeros((0, 4, 3)), np.zeros(4)),
        (np.zeros((5, 0, 3)), np.zeros(0)),
        (np.zeros((5, 4, 2)), np.zeros(4)),
        (np.zeros((5, 4, 3)), np.zeros(3)),
        (np.full((5, 4, 3), np.nan), np.zeros(4)),
        (np.zeros((5, 4, 3)), np.full(4, 7)),
    ],
)
def test_clouds_that_are_none_are_refused(network, points, groups):
    with pytest.raises(InputError, match="cloud"):
        decode_cloud(network, points, groups)


def test_other_checkpoints_are_refused(tmp_path):
    write_random_weights(tmp_path)
    with pytest.raises(InputError, match="no network of a rig"):
        load_rig_network(tmp_path / "ae")
