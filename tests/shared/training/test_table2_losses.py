"""The autoencoder's loss under the settings of PUMPS Table 2."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import pytest
import torch
from pydantic import ValidationError

from data_schemas.tpc import TpcReader
from stages.shared.networks.layers.sizes import DecoderSizes, EncoderSizes
from stages.shared.pointcloud.assignment import chamfer_squared, paired_difference
from stages.shared.training.stage import window_pools
from stages.shared.training.task import step_generator, step_random
from stages.shared.training.windows import draw_clouds
from stages.train.ae.config import Config
from stages.train.ae.task import AutoencoderTask, Reconstruction
from tests.shared.training.tiny_clouds import write_clouds

SIZES = {"width": 16, "layers": 1, "heads": 2, "noise": 4, "point_width": 8, "point_hidden": 8, "dropout": 0.0}


@pytest.fixture(scope="module")
def clouds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_clouds(tmp_path_factory.mktemp("losses") / "tpc")


class LossOfParts(NamedTuple):
    """The first batch's loss by an untrained network, its logged figures, and the reconstruction that it judges."""

    value: float
    figures: dict[str, float]
    made: Reconstruction


def loss_of(clouds: Path, **settings) -> LossOfParts:
    decoder = DecoderSizes(**{**SIZES, **settings.pop("decoder", {})})
    config = Config(
        tpc=clouds, output=clouds / "x", encoder=EncoderSizes(width=4, blocks=2, neighbours=4, heads=2),
        decoder=decoder, batch=2, window=8, points=24, mixed_precision=False, device="cpu", **settings,
    )  # fmt: skip
    with TpcReader(clouds) as reader:
        task = AutoencoderTask(config, *window_pools(reader, config), torch.device("cpu"))
        batch = task.draw(step_random(0, 1, 0, range(2)))
        value, figures = task.loss(batch, step_generator(0, 2, 0, range(2), torch.device("cpu")))
        made = task._reconstruct(batch, step_generator(0, 2, 0, range(2), torch.device("cpu")))
    return LossOfParts(float(value.detach()), {name: float(each) for name, each in figures.items()}, made)


def test_the_loss_is_the_mean_square_of_assigned_pairs(clouds: Path):
    value, figures, (made, points, groups, valid, _) = loss_of(clouds)
    assert bool(valid.all())
    expected = paired_difference(made, points, groups).square().sum(-1).mean() / 0.01
    assert value == pytest.approx(float(expected.detach()), rel=1e-4) == pytest.approx(figures["rec"], rel=1e-4)


def test_what_varies_can_count_more(clouds: Path):
    plain, figures, _ = loss_of(clouds)
    weighted, _, _ = loss_of(clouds, variation_weight=3.0)
    assert weighted == pytest.approx(plain + 3 * figures["moving"], rel=1e-4)


def test_chamfer_pairs_nearest_trajectories(clouds: Path):
    value, _, (made, points, groups, valid, _) = loss_of(clouds, loss="chamfer")
    assert value == pytest.approx(float(chamfer_squared(made, points, groups, valid).detach()) / 0.01, rel=1e-4)
    assert value < loss_of(clouds).value


def test_a_vaes_loss_has_its_codes_divergence(clouds: Path):
    free, figures, _ = loss_of(clouds, decoder={"identities": "vae"}, prior_weight=0.0)
    bound, _, _ = loss_of(clouds, decoder={"identities": "vae"}, prior_weight=1.0)
    assert figures["divergence"] > 0
    assert bound == pytest.approx(free + 2 * figures["divergence"], rel=1e-4)


def test_unknown_losses_are_refused(clouds: Path):
    with pytest.raises(ValidationError, match="assignment, chamfer"):
        loss_of(clouds, loss="sinkhorn")


@pytest.mark.parametrize(("share", "wanted"), [(0.0, 0), (0.25, 2), (0.5, 4), (1.0, 8)])
def test_a_share_of_the_steps_sees_points_spread_evenly(clouds: Path, monkeypatch, share, wanted):
    config = Config(tpc=clouds, output=clouds / "x", batch=4, window=8, points=24, device="cpu", even_share=share)
    seen: list[bool] = []

    def drawn(*given, even, **named):
        seen.append(even)
        return draw_clouds(*given, even=even, **named)

    with TpcReader(clouds) as reader:
        task = AutoencoderTask(config, *window_pools(reader, config), torch.device("cpu"))
        monkeypatch.setattr("stages.train.ae.task.draw_clouds", drawn)
        for step in range(8):
            for rows in (range(2), range(2, 4)):  # parts of one batch are spread alike
                task.draw(step_random(0, 1, step, rows))
    assert seen[::2] == seen[1::2]
    assert sum(seen[::2]) == wanted
