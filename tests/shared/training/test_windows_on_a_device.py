"""Windows made where the networks are: the same windows, and no step waits for the device."""

import contextlib
from dataclasses import fields

import numpy as np
import pytest
import torch

from data_schemas.tpc import TpcReader
from stages.shared.inference.models import load_autoencoder
from stages.shared.networks.layers import row_generator
from stages.shared.synthesiser_training.task import SynthesiserTask
from stages.shared.training import task as training_task
from stages.shared.training.stage import window_pools
from stages.shared.training.task import step_generator, step_random
from stages.shared.training.windows import WindowPool, Windows
from stages.train.lms.config import Config
from tests.shared.inference.examples import write_random_weights
from tests.shared.training.tiny_clouds import write_clouds

# PyTorch's device without data: every shape and device is checked, and reading a value on the host is an error.
META = torch.device("meta")


@pytest.fixture(scope="module")
def reader(tmp_path_factory):
    with TpcReader(write_clouds(tmp_path_factory.mktemp("clouds") / "tpc", clips=4, frames=300)) as reader:
        yield reader


def test_windows_are_the_same_where_all_frames_are_kept_at_once(reader):
    read, kept = WindowPool(reader, ("train",)), WindowPool(reader, ("train",))
    kept._keep_all_frames()
    for seed in range(8):
        one, two = (
            pool.draw(5, 40, np.random.default_rng(seed), augment=True, proportions=1.2) for pool in (read, kept)
        )
        for field in fields(Windows):
            assert torch.equal(getattr(one, field.name), getattr(two, field.name)), field.name


def test_a_step_of_the_synthesiser_never_waits_for_its_device(reader, tmp_path, monkeypatch):
    write_random_weights(tmp_path / "weights")
    config = Config(
        tpc=reader.artefact.path, ae=tmp_path / "weights" / "ae", output=tmp_path / "lms",
        batch=3, window=24, points=32, longest_gap=12, proportions=1.1, recorded_share=0.5,
    )  # fmt: skip
    monkeypatch.setattr(WindowPool, "_fits", lambda self, device: device.type != "cpu")
    monkeypatch.setattr(torch, "autocast", lambda *_, **__: contextlib.nullcontext())  # there is none for meta
    monkeypatch.setattr(training_task, "row_generator", lambda seed, rows, _: _on_cpu(seed, rows))
    models = load_autoencoder(config.ae, "cpu")
    task = SynthesiserTask(config, models, *window_pools(reader, config), torch.device("cpu"))
    for network in (task.frozen.encoder, task.frozen.decoder, task.networks):
        network.to(META)
    task.device = task.frozen.device = META
    task.drawer().pool = WindowPool(reader, ("train",), device=META)

    batch = task.draw(step_random(0, 1, 0, range(3)))
    loss, values = task.loss(batch, step_generator(0, 2, 0, range(3), META))
    loss.backward()

    assert batch.points.device == loss.device == META
    assert all(value.device == META for value in values.values())
    assert all(weight.grad is not None for weight in task.networks.parameters())


def _on_cpu(seed: int, rows: list[int]) -> torch.Generator:
    return row_generator.row_generator(seed, rows, torch.device("cpu"))
