"""Training the interpolator in pose space: invariances of the network, its batches, and a training to the end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import roma
import torch

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError
from data_schemas.tpc import TpcReader
from stages.shared.kinematics.forward import joint_positions
from stages.shared.kinematics.rest_pose import carried_offsets, realign
from stages.shared.kinematics.window_interpolation import interpolate_windows
from stages.shared.networks.layers.sizes import InterpolatorSizes
from stages.shared.networks.pcmrl.pose_interpolator import PoseInterpolator, PoseWindows
from stages.shared.training.pose_windows import errors_of, pose_batch
from stages.shared.training.task import step_random
from stages.shared.training.windows import WindowPool
from stages.train.citl.config import Config
from stages.train.citl.run import run
from stages.train.citl.task import InterpolatorTask
from tests.shared.training.tiny_clouds import GROUPS, PARENTS, TAILS, swinging, write_clouds

FRAMES = 31
SIZES = InterpolatorSizes(width=24, heads=2, key_layers=1, fill_layers=1, frame_layers=1, longest=12)
KNOWN = (torch.arange(FRAMES) % 10 == 0).expand(2, -1)
TIMES = torch.arange(float(FRAMES)).unsqueeze(0)


def windows(seed: int = 0) -> PoseWindows:
    """Two windows of swinging, in float64 so that invariances show sharply."""
    rng = np.random.default_rng(seed)
    parts = [swinging(rng, FRAMES) for _ in range(2)]
    heads, rotations = (torch.from_numpy(np.stack(part)) for part in zip(*parts, strict=True))
    return PoseWindows(heads, rotations, torch.from_numpy(TAILS).expand(2, -1, 3))


def base_of(truth: PoseWindows) -> PoseWindows:
    parents = torch.from_numpy(PARENTS.astype(np.int64)).expand(2, -1)
    return PoseWindows(*interpolate_windows(truth.heads, truth.rotations, parents, KNOWN, rate_hz=30.0), truth.tails)


def network() -> PoseInterpolator:
    """With an output that is no longer zero."""
    torch.manual_seed(0)
    made = PoseInterpolator(PARENTS.tolist(), GROUPS.tolist(), SIZES)
    torch.nn.init.normal_(made.out.weight, std=0.05)
    return made.eval()


def filled(truth: PoseWindows) -> tuple[torch.Tensor, torch.Tensor]:
    with torch.no_grad():
        return network()(truth, base_of(truth), KNOWN, TIMES)


def test_untrained_it_is_the_plain_interpolation_and_keys_come_back():
    truth = windows()
    base = base_of(truth)
    heads, rotations = PoseInterpolator(PARENTS.tolist(), GROUPS.tolist(), SIZES)(truth, base, KNOWN, TIMES)
    torch.testing.assert_close(heads, base.heads, atol=1e-5, rtol=0)
    same = (rotations * base.rotations).sum(-1).abs()
    torch.testing.assert_close(same, torch.ones_like(same), atol=1e-6, rtol=0)
    heads, rotations = filled(truth)
    assert (heads[KNOWN] == truth.heads[KNOWN]).all() and (rotations[KNOWN] == truth.rotations[KNOWN]).all()
    assert (heads - base.heads).abs().max() > 0.01


def test_rows_between_keys_are_not_read():
    truth = windows()
    first = filled(truth)
    junk = PoseWindows(truth.heads.clone(), truth.rotations.clone(), truth.tails)
    junk.heads[~KNOWN] = 7.0
    junk.rotations[~KNOWN] = torch.tensor([0.0, 0.0, 0.0, 1.0])
    for one, other in zip(filled(junk), first, strict=True):
        assert (one == other).all()


def test_poses_are_possible_on_the_skeleton():
    truth = windows()
    heads, rotations = filled(truth)
    steps = roma.quat_action(
        roma.quat_conjugation(truth.rotations[:, 0, PARENTS[1:]]),
        truth.heads[:, 0, 1:] - truth.heads[:, 0, PARENTS[1:]],
    )
    offsets = torch.cat([torch.zeros(2, 1, 3), steps], 1).unsqueeze(1)
    torch.testing.assert_close(joint_positions(rotations, heads[:, :, 0], offsets, PARENTS), heads, atol=1e-4, rtol=0)


def test_where_a_motion_is_and_which_way_it_faces_mean_nothing():
    truth = windows()
    heads, rotations = filled(truth)
    yaw = roma.rotvec_to_unitquat(torch.tensor([0.0, 2.1, 0.0]))
    shift = torch.tensor([3.0, -1.0, 5.0])

    def move(points: torch.Tensor) -> torch.Tensor:
        return roma.quat_action(yaw.expand(*points.shape[:-1], 4), points) + shift

    def turn(turns: torch.Tensor) -> torch.Tensor:
        return roma.quat_product(yaw.expand_as(turns), turns)

    moved = filled(PoseWindows(move(truth.heads), turn(truth.rotations), truth.tails))
    torch.testing.assert_close(moved[0], move(heads), atol=1e-3, rtol=0)
    same = (moved[1] * turn(rotations)).sum(-1).abs()
    torch.testing.assert_close(same, torch.ones_like(same), atol=1e-4, rtol=0)


@pytest.mark.parametrize("seed", range(2))
def test_rolls_and_rest_poses_mean_nothing(seed: int):
    """Each bone's frame is turned by a constant (a roll and more): positions stay, rotations carry the constant."""
    truth = windows()
    heads, rotations = filled(truth)
    generator = torch.Generator().manual_seed(seed)
    tails = torch.nn.functional.normalize(torch.randn(TAILS.shape, generator=generator), dim=-1)
    tails = (tails * truth.tails[0].norm(dim=-1, keepdim=True)).expand(2, -1, 3)
    old = torch.zeros_like(truth.tails)
    old[:, 1:] = truth.tails[:, PARENTS[1:]]
    offsets = carried_offsets(old, truth.tails, tails, PARENTS)
    other_heads, other_rotations = realign(truth.heads, truth.rotations, truth.tails, offsets, tails, PARENTS)
    roll = roma.rotvec_to_unitquat(torch.nn.functional.normalize(tails, dim=-1) * 1.3).unsqueeze(1)
    rolled = roma.quat_product(other_rotations, roll.expand_as(other_rotations))
    constant = roma.quat_product(roma.quat_conjugation(truth.rotations[:, :1]), rolled[:, :1])
    found = filled(PoseWindows(other_heads, rolled, roma.quat_action(roma.quat_conjugation(roll[:, 0]), tails)))
    torch.testing.assert_close(found[0], heads, atol=2e-3, rtol=0)
    same = (found[1] * roma.quat_product(rotations, constant.expand_as(rotations))).sum(-1).abs()
    torch.testing.assert_close(same, torch.ones_like(same), atol=1e-4, rtol=0)


def test_first_frames_must_be_known():
    truth = windows()
    with pytest.raises(ValueError):
        network()(truth, truth, KNOWN.roll(2, dims=1), TIMES)


def small(folder: Path, **others) -> Config:
    values = {
        "tpc": folder / "tpc", "output": folder / "citl", "steps": 30, "batch": 4, "window": 32, "warmup": 5,
        "learning_rate": 1e-2, "validate_every": 30, "checkpoint_every": 10, "network": SIZES, "device": "cpu",
    }  # fmt: skip
    return Config(**(values | others))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("citl")
    write_clouds(made / "tpc")
    return made


def test_batches_have_other_rest_poses_and_bases_made_of_the_keys(folder: Path):
    with TpcReader(folder / "tpc") as reader:
        pool = WindowPool(reader, ("train",))
        tasks = [
            InterpolatorTask(small(folder, rest_pose_m=m, augment=False, batch=8), pool, pool, torch.device("cpu"))
            for m in (0.0, 0.05)
        ]
        plain, other = (task.draw(step_random(3, 1, 0, range(8))) for task in tasks)
    changed = (plain.truth.heads - other.truth.heads).flatten(1).norm(dim=1) > 1e-3
    assert 0 < int(changed.sum()) < 8
    assert (other.truth.tails[~changed] == plain.truth.tails[~changed]).all()
    assert other.known[:, 0].all() and not (other.known & ~other.valid).any()
    torch.testing.assert_close(other.base.heads[other.known], other.truth.heads[other.known], atol=1e-5, rtol=0)
    with TpcReader(folder / "tpc") as reader:
        pool = WindowPool(reader, ("train",))
        task = InterpolatorTask(small(folder, rest_pose_m=0.05, augment=False), pool, pool, torch.device("cpu"))
        part = task.draw(step_random(3, 1, 0, [2, 5]))
    assert (part.truth.heads == other.truth.heads[[2, 5]]).all(), "a part of a batch is that part"
    assert (part.known == other.known[[2, 5]]).all()
    assert all(float(value) > 0 for value in errors_of(other.base, other).values())
    assert all(float(value) < 1e-3 for value in errors_of(other.truth, other).values())


def test_one_batch_is_learnt(folder: Path):
    with TpcReader(folder / "tpc") as reader:
        pool = WindowPool(reader, ("train",))
        task = InterpolatorTask(small(folder), pool, pool, torch.device("cpu"))
        windows = pool.draw(4, 31, np.random.default_rng(0), augment=False)
        batch = pose_batch(windows, KNOWN[:1] & windows.valid)
    optimiser = torch.optim.Adam(task.networks.parameters(), lr=3e-2)
    losses = []
    for _ in range(15):
        loss, figures = task.loss(batch, torch.Generator())
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.9 * losses[0] and figures["l2p_of_base"] < 0.85


def test_trains_to_the_end_the_same_each_time_and_says_on_what(folder: Path):
    report = run(small(folder, steps=4, validate_every=4))
    found = read_checkpoint(folder / "citl")
    assert found.config["network"] == "pose-interpolator" and found.config["parents"] == PARENTS.tolist()
    assert report.figures["finished"] and 0.5 < report.figures["val"]["score"] < 1.05
    assert "archive0.zip" in report.lines[0]
    again = run(small(folder, steps=4, validate_every=4, output=folder / "again"))
    assert (read_checkpoint(again.output).weights["out.weight"] == found.weights["out.weight"]).all()


def test_skeletons_of_several_hierarchies_are_refused(folder: Path, monkeypatch: pytest.MonkeyPatch):
    with TpcReader(folder / "tpc") as reader:
        pool = WindowPool(reader, ("train",))
        pool.parents = torch.cat([pool.parents, pool.parents.roll(1, dims=1)])
        pool.groups = pool.groups.expand(2, -1)
        with pytest.raises(InputError, match="hierarchies"):
            InterpolatorTask(small(folder), pool, pool, torch.device("cpu"))
