"""`pumps train finetune`: it learns a task of one rig, from weights or from scratch, and is used by `denoise`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError, UsageError
from data_schemas.tpc import TpcReader
from stages.denoise.config import Config as DenoiseConfig
from stages.denoise.run import run as denoise
from stages.measure.denoise.config import Config as MeasureConfig
from stages.measure.denoise.run import run as measure
from stages.shared.formats.rig_file import rig_of_file
from stages.shared.inference.pose_model import load_pose_model
from stages.shared.pose_tasks.body_pose import outputs_of
from stages.shared.pose_tasks.registry import task_named
from stages.shared.training.pose_training import PoseTraining, rig_pools
from stages.shared.training.task import step_random
from stages.train.finetune.config import Config
from stages.train.finetune.run import run, started_network
from tests.shared.training.tiny_clouds import write_clouds
from tests.train.finetune.rig_clouds import RIG, SMALL, write_rig_clouds


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three of the embedded clips, of which one is for tests, and their clouds."""
    made = tmp_path_factory.mktemp("finetune")
    write_rig_clouds(made)
    return made


def small(folder: Path, name: str, **others) -> Config:
    values = {"task": "denoise", "skeleton": RIG, "tpc": folder / "tpc", "output": folder / name, **SMALL}
    return Config(**(values | others))


def test_one_batch_is_learnt(folder: Path):
    config, rig = small(folder, "learns"), rig_of_file(RIG)
    with TpcReader(folder / "tpc") as reader:
        task = task_named("denoise", rig)
        torch.manual_seed(0)
        network, _, _ = started_network(config, task.features, outputs_of(rig.body))
        pools = rig_pools(reader, rig, config)
        training = PoseTraining(config, task, network, *pools, torch.device("cpu"), {"quaternion": 0.5})
        batch = training.draw(step_random(3, 1, 0, range(3)))
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-2)
    losses = []
    for _ in range(30):
        loss, _ = training.loss(batch, torch.Generator())
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.75 * losses[0]


@pytest.mark.parametrize("task", ["repair", "trackers"])
def test_other_tasks_train(folder: Path, task: str):
    report = run(small(folder, task, task=task))
    kept = read_checkpoint(folder / task).config
    assert report.figures["finished"] and kept["task"] == task and kept["rig"]["skeleton"]


def test_a_killed_run_resumes_to_the_same_weights(folder: Path):
    whole = run(small(folder, "whole", checkpoint_every=2, max_time=0))
    part = run(small(folder, "part", checkpoint_every=2, max_time=1e-9))
    while not part.figures["finished"]:
        part = run(small(folder, "part", checkpoint_every=2, max_time=0))
    one, two = (read_checkpoint(each.output).weights for each in (whole, part))
    assert all((one[name] == two[name]).all() for name in one)


def test_the_weights_that_it_starts_from_are_inside(folder: Path):
    run(small(folder, "tuned", from_="small-free", steps=1, learning_rate=1e-9, average=0.0))
    kept = read_checkpoint(folder / "tuned")
    source = read_checkpoint("stages/shared/weights/small-free/lms").weights
    for name, value in source.items():
        np.testing.assert_allclose(kept.weights[f"inner.synthesiser.{name}"], value, atol=1e-5)
    assert [each.steps for each in kept.trainings][-1] == 1


def test_denoise_and_measure_use_it(folder: Path):
    run(small(folder, "net", task="repair"))
    report = denoise(
        DenoiseConfig(
            input=Path(RIG), output=folder / "out.bvh", weights=folder / "net", device="cpu", overwrite=True
        )
    )
    assert report.figures["frames"] == 152 and (folder / "out.bvh").exists()
    with pytest.raises(InputError, match="not estimate"):
        load_pose_model(folder / "net", "estimate")
    settings = {"tpc": folder / "tpc", "window": 64, "device": "cpu", "overwrite": True}
    measured = measure(MeasureConfig(**settings, weights=(f"net={folder / 'net'}",), output=folder / "measured"))
    assert measured.figures["methods"][-1] == "net" and measured.figures["windows"] == 2


def test_bad_input_is_refused(folder: Path):
    write_clouds(folder / "others")
    with pytest.raises(InputError, match="no motion of the rig"):
        run(small(folder, "never", tpc=folder / "others"))
    with pytest.raises(UsageError, match="no task"):
        run(small(folder, "never", task="juggle"))
    with pytest.raises(UsageError, match="no network"):
        run(small(folder, "never", network="oracle"))
    assert not (folder / "never").exists()
