"""A loss that is a mean over missing frames averages right over parts that have unequally many of them."""

import pytest
import torch

from data_schemas.tpc import TpcReader
from stages.shared.inference.models import load_autoencoder
from stages.shared.synthesiser_training.task import SynthesiserTask
from stages.shared.training.stage import window_pools
from stages.shared.training.task import step_generator, step_random
from stages.train.lms.config import Config
from tests.shared.inference.examples import write_random_weights
from tests.shared.training.tiny_clouds import write_clouds


def test_the_synthesisers_loss_of_a_batch_is_that_of_its_parts(tmp_path):
    clouds = write_clouds(tmp_path / "tpc")
    sizes = {"width": 16, "heads": 2, "key_layers": 1, "fill_layers": 1, "frame_layers": 1}
    ae = write_random_weights(tmp_path / "weights") / "ae"
    config = Config(
        tpc=clouds, ae=ae, output=tmp_path / "lms", window=24, points=32, synthesiser=sizes, mixed_precision=False
    )
    cpu = torch.device("cpu")
    with TpcReader(clouds) as reader:
        task = SynthesiserTask(config, load_autoencoder(ae, "cpu"), *window_pools(reader, config), cpu)
        losses, weights = [], []
        for rows in (range(5), range(2), range(2, 5)):
            batch = task.draw(step_random(0, 1, 3, rows))
            losses.append(task.loss(batch, step_generator(0, 2, 3, rows, cpu))[0].item())
            weights.append(task.weight(batch, len(rows)))
    assert weights[0] == weights[1] + weights[2]
    assert weights[1] / weights[2] != pytest.approx(2 / 3, rel=0.05)  # or a plain mean would do
    assert losses[0] == pytest.approx((losses[1] * weights[1] + losses[2] * weights[2]) / weights[0], rel=1e-4)
