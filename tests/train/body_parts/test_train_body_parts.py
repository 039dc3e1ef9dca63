"""Training body parts: alone as together, what is learnt, schedules, bad input."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError
from data_schemas.manifest import open_artefact
from data_schemas.motion import MotionReader
from pumps_cli.app import main
from stages.shared.humanoid.clips_on_rig import body_joints_of, clips_on_rig, rig_of_clips
from stages.shared.training.task import step_random
from stages.train.body_parts.config import Config
from stages.train.body_parts.run import run
from stages.train.body_parts.task import PartsTask
from tests.train.body_parts.small_parts import ingested, settings


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ingested(tmp_path_factory.mktemp("parts"))


def _task(motion: Path, config: Config) -> PartsTask:
    with MotionReader(motion) as reader:
        rows = [row for row in reader.clips if row.split == "train"]
        body = body_joints_of(*rig_of_clips(reader, rows))
        clips, _ = clips_on_rig(reader, rows, body, config.rate_hz, config.window)
    return PartsTask(config, body, clips, clips, torch.device("cpu"))


def test_a_part_trained_alone_has_the_same_weights(motion: Path, tmp_path: Path):
    run(settings(motion, tmp_path / "all", parts=5, network="vae"))
    run(settings(motion, tmp_path / "alone", parts=5, part="left_leg", network="vae"))
    together, alone = (read_checkpoint(tmp_path / name).weights for name in ("all", "alone"))
    assert alone and set(alone) == {name for name in together if name.startswith("left_leg.")}
    for name, value in alone.items():
        np.testing.assert_array_equal(value, together[name], err_msg=name)


@pytest.mark.parametrize(("parts", "network"), [(1, "svae"), (1, "ae"), (2, "pae"), (2, "vae")])
def test_the_loss_of_fixed_windows_falls(motion: Path, tmp_path: Path, parts: int, network: str):
    config = settings(motion, tmp_path / "out", parts=parts, network=network, kl_weight=0.0)
    task = _task(motion, config)
    batch = task.draw(step_random(0, 1, 0, range(4)))
    optimiser = torch.optim.Adam(task.networks.parameters(), 3e-3)
    values = []
    for _ in range(20):
        loss, _ = task.loss(batch, torch.Generator().manual_seed(0))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        values.append(float(loss.detach()))
    assert min(values) < 0.9 * values[0], values


def test_no_gradient_of_a_part_reaches_another(motion: Path, tmp_path: Path):
    task = _task(motion, settings(motion, tmp_path / "out", parts=2))
    columns = task.draw(step_random(0, 1, 0, range(2))).columns
    terms, _ = task._terms(task.parts[1], columns, None, sampled=False)
    terms["mpjae"].backward()
    assert all(value.grad is None for value in task.networks["upper"].parameters())
    assert any(value.grad is not None for value in task.networks["lower"].parameters())


def test_the_learning_rate_is_triangles_that_shrink(motion: Path, tmp_path: Path):
    config = settings(motion, tmp_path / "out", parts=1, cycle=10, cycle_low=0.2, cycle_decay=0.5, learning_rate=1.0)
    rates = [_task(motion, config).rate(step) for step in range(20)]
    wanted = [0.2 + 0.8 * h for h in (0.2, 0.4, 0.6, 0.8, 1.0, 0.8, 0.6, 0.4, 0.2, 0.0)]
    np.testing.assert_allclose(rates[:10], wanted)
    np.testing.assert_allclose(rates[10:], np.array(wanted) / 2)


def test_the_divergence_s_weight_rises_in_half_of_each_cycle(motion: Path, tmp_path: Path):
    task = _task(motion, settings(motion, tmp_path / "out", parts=1, network="vae", steps=32, kl_cycles=4))
    weights = [task.divergence_weight(step) / 0.005 for step in range(16)]
    np.testing.assert_allclose(weights, [0, 0.25, 0.5, 0.75, 1, 1, 1, 1] * 2)


def test_the_penalty_of_weights_is_the_sum_of_their_magnitudes(motion: Path, tmp_path: Path):
    values = []
    for weight in (0.0, 1e-3):
        task = _task(motion, settings(motion, tmp_path / "out", parts=1, l1_weight=weight))
        batch = task.draw(step_random(0, 1, 0, range(2)))
        values.append(float(task.loss(batch, torch.Generator())[0].detach()))
        size = sum(float(value.detach().abs().sum()) for value in task.networks.parameters())
    assert values[1] - values[0] == pytest.approx(1e-3 * size, rel=1e-3)


def test_the_checkpoint_names_its_parts_and_its_licences(motion: Path, tmp_path: Path):
    report = run(settings(motion, tmp_path / "out", parts=3, network="svae"))
    artefact = open_artefact(tmp_path / "out", "checkpoint")
    config = read_checkpoint(artefact).config
    assert (config["kind"], config["parts"], config["trained"]) == ("svae", 3, ["spine", "arms", "legs"])
    assert artefact.manifest.licences == ["CC0"]
    counted = sum(report.figures["parameters_of"].values())
    assert f"Parameters: {counted:,}" in report.lines[-1]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"window": 400}, "no clip of use at 30 frames a second: 1 shorter than a window"),
        ({"rate_hz": 2.0}, "no clip of use at 2 frames a second"),
    ],
)
def test_windows_longer_than_every_clip_are_refused(motion: Path, tmp_path: Path, changed, words: str):
    with pytest.raises(InputError, match=words):
        run(settings(motion, tmp_path / "out", **changed))
    assert not (tmp_path / "out").exists()


def test_a_rate_that_does_not_divide_is_told(motion: Path, tmp_path: Path):
    report = run(settings(motion, tmp_path / "out", rate_hz=48.0))
    assert "1 of 1 clips were interpolated to 48 frames a second, from 30." in report.lines


def test_a_part_of_another_decomposition_is_a_usage_error(motion: Path, tmp_path: Path, capsys):
    words = [
        "train",
        "body-parts",
        "--motion",
        str(motion),
        "--parts",
        "2",
        "--part",
        "left_arm",
        "-o",
        str(tmp_path),
    ]
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    assert "part must be one of upper, lower, not left_arm" in capsys.readouterr().err


def test_an_output_that_exists_is_kept_without_overwrite(motion: Path, tmp_path: Path, capsys):
    run(settings(motion, tmp_path / "out"))
    before = open_artefact(tmp_path / "out", "checkpoint").manifest.digest
    with pytest.raises(SystemExit) as ended:
        main(["train", "body-parts", "--motion", str(motion), "--steps", "1", "-o", str(tmp_path / "out")])
    assert ended.value.code == 2
    assert open_artefact(tmp_path / "out", "checkpoint").manifest.digest == before
