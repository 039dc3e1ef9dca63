"""Every method of `pumps train baseline` learns, changes no key, reads nothing between keys, repeats itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from pydantic import ValidationError

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import UsageError
from data_schemas.tpc import TpcReader
from stages.shared.kinematics.rotations import aligned_signs, continuous_signs
from stages.shared.networks.inbetween.methods import METHODS, method_class
from stages.shared.networks.inbetween.pose_ndf import PoseNdf, nearest_distance
from stages.shared.networks.inbetween.windows import denoised_bones, filled_bones
from stages.shared.networks.layers.sizes import MethodSizes
from stages.shared.training.pose_windows import PoseBatch, pose_batch
from stages.shared.training.windows import WindowPool
from stages.train.baseline.config import Config
from stages.train.baseline.run import run
from stages.train.baseline.task import BaselineTask
from tests.shared.training.tiny_clouds import write_clouds

SIZES = MethodSizes(width=32, layers=2, heads=2)
LEARNERS = [name for name in METHODS if name not in ("pose-ndf", "motion-vae")]  # their loss is not of filled gaps


def small(folder: Path, method: str, **others) -> Config:
    values = {
        "tpc": folder / "tpc", "output": folder / method, "method": method, "steps": 4, "batch": 4, "window": 31,
        "warmup": 5, "validate_every": 4, "checkpoint_every": 10, "network": SIZES, "device": "cpu",
    }  # fmt: skip
    return Config(**(values | others))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("baselines")
    write_clouds(made / "tpc")
    return made


def task_and_batch(folder: Path, method: str) -> tuple[BaselineTask, PoseBatch]:
    with TpcReader(folder / "tpc") as reader:
        pool = WindowPool(reader, ("train",))
        task = BaselineTask(small(folder, method), method_class(method), pool, pool, torch.device("cpu"))
        windows = pool.draw(4, 31, np.random.default_rng(0), augment=False)
    return task, pose_batch(windows, (torch.arange(31) % 10 == 0) & windows.valid)


def shaken(task: BaselineTask) -> BaselineTask:
    """With outputs that are not zero any more."""
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        for parameter in task.networks.parameters():
            parameter.add_(0.05 * torch.randn(parameter.shape, generator=generator))
    return task


def filled(task: BaselineTask, batch: PoseBatch, junk: float | None = None) -> tuple[torch.Tensor, torch.Tensor]:
    heads, rotations = batch.truth.heads.clone(), batch.truth.rotations.clone()
    if junk is not None:
        heads[~batch.known], rotations[~batch.known] = junk, torch.tensor([0.0, 0.0, 0.0, 1.0])
    with torch.no_grad():
        return filled_bones(
            task.networks, (heads, rotations), (batch.base.heads, batch.base.rotations), batch.known, batch.valid
        )


@pytest.mark.parametrize("method", METHODS)
def test_no_key_changes_and_nothing_between_keys_is_read(folder: Path, method: str):
    task, batch = task_and_batch(folder, method)
    heads, rotations = filled(shaken(task), batch)
    assert (heads[batch.known] == batch.truth.heads[batch.known]).all()
    assert (rotations[batch.known] == batch.truth.rotations[batch.known]).all()
    assert float((rotations - batch.base.rotations)[batch.valid & ~batch.known].abs().max()) > 1e-4
    other = filled(task, batch, junk=7.0)
    assert (other[0] == heads).all() and (other[1] == rotations).all()


@pytest.mark.parametrize("method", LEARNERS)
def test_one_motion_is_learnt(folder: Path, method: str):
    """After a few steps on one batch its gaps are filled with less than two thirds of the error before."""
    task, batch = task_and_batch(folder, method)
    gaps = batch.valid & ~batch.known

    def error() -> float:
        return float((filled(task, batch)[0] - batch.truth.heads)[gaps].norm(dim=-1).mean())

    before = error()
    optimiser = torch.optim.Adam(task.networks.parameters(), lr=5e-3)
    for _ in range(35):
        loss, _ = task.loss(batch, torch.Generator().manual_seed(0))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    assert error() < 0.66 * before


def test_pose_ndf_learns_distances_and_descends_them(folder: Path):
    task, batch = task_and_batch(folder, "pose-ndf")
    optimiser = torch.optim.Adam(task.networks.parameters(), lr=1e-2)
    losses = []
    for step in range(80):
        loss, _ = task.loss(batch, torch.Generator().manual_seed(step))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    assert np.mean(losses[-5:]) < 0.6 * losses[0]
    space, network = task.networks.space, task.networks
    assert isinstance(network, PoseNdf)
    vectors = space.vectors(batch.truth.heads, batch.truth.rotations, space.placement(batch.truth.heads, batch.known))
    poses = space.local(vectors)[batch.valid]
    noisy = torch.nn.functional.normalize(poses + 0.3 * torch.randn(poses.shape, generator=torch.Generator()), dim=-1)
    with torch.no_grad():
        assert float(network.distance(noisy).mean()) > 1.5 * float(network.distance(poses).mean())


@pytest.mark.parametrize("method", ["pose-ndf", "motion-vae"])
def test_priors_bring_noisy_motion_nearer_to_the_truth(folder: Path, method: str):
    task, batch = task_and_batch(folder, method)
    optimiser = torch.optim.Adam(task.networks.parameters(), lr=5e-3)
    for step in range(60):
        loss, _ = task.loss(batch, torch.Generator().manual_seed(step))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    generator = torch.Generator().manual_seed(0)
    rotations = batch.truth.rotations
    noisy = rotations + 0.1 * torch.randn(rotations.shape, generator=generator)
    noisy = torch.nn.functional.normalize(noisy, dim=-1)
    heads, made = denoised_bones(task.networks, (batch.truth.heads, noisy))
    assert made.shape == rotations.shape and torch.isfinite(heads).all()

    def bends(turns: torch.Tensor) -> float:
        return float(continuous_signs(turns, axis=1).diff(n=2, dim=1).norm(dim=-1).mean())

    def apart(turns: torch.Tensor) -> float:
        return float((aligned_signs(turns, rotations) - rotations).norm(dim=-1)[batch.valid].mean())

    assert bends(made) < 0.7 * bends(noisy) and apart(made) < apart(noisy)


def test_nearest_distance_is_that_of_a_loop():
    generator = torch.Generator().manual_seed(1)
    poses, bank = (torch.nn.functional.normalize(torch.randn(n, 5, 4, generator=generator), dim=-1) for n in (3, 6))
    found = nearest_distance(poses, bank)
    for pose, value in zip(poses, found, strict=True):
        slow = min(
            sum((2 * np.arccos(min(1.0, abs(float(a @ b))))) ** 2 for a, b in zip(pose[1:], each[1:], strict=True))
            ** 0.5
            for each in bank
        )
        assert float(value) == pytest.approx(slow, rel=1e-4)


def test_a_run_writes_its_checkpoint_twice_the_same(folder: Path):
    report = run(small(folder, "delta"))
    found = read_checkpoint(folder / "delta")
    assert (found.config["network"], found.config["method"]) == ("inbetween", "delta")
    assert report.figures["finished"] and 0.3 < report.figures["val"]["score"] < 3
    assert "archive0.zip" in report.lines[0]
    run(small(folder, "delta", output=folder / "again"))
    again = read_checkpoint(folder / "again")
    assert all((again.weights[name] == value).all() for name, value in found.weights.items())
    assert float(found.weights["space.deviation"].min()) > 0


def test_the_papers_numbers_stand_where_no_others_are_given():
    paper = method_class("two-stage").PAPER
    assert MethodSizes(width=8).over(paper.sizes) == MethodSizes(width=8, layers=6, heads=8)


def test_unknown_methods_are_refused(folder: Path):
    with pytest.raises(ValidationError, match="two-stage"):
        small(folder, "best")
    with pytest.raises(UsageError, match="no method 'best'"):
        method_class("best")
