"""Windows that serve in several steps: each equally often, in other company every time, the same after a resume."""

from collections import Counter

import torch

from data_schemas.tpc import TpcReader
from stages.inference.models import load_autoencoder
from stages.train_lms.config import Config
from stages.train_lms.rounds import DRAWS, drawing_step, draws_afresh
from stages.train_lms.task import AgainBatch, SynthesiserTask
from stages.training.stage import window_pools
from stages.training.task import step_generator, step_random

from ..inference.examples import write_random_weights
from ..training.tiny_clouds import write_clouds

CPU = torch.device("cpu")


def test_every_window_serves_as_often_as_said():
    reuse, rows = 3, range(2)
    for begin in (0, reuse * DRAWS):
        for row in rows:
            used = Counter(drawing_step(begin + step, row, reuse, seed=0) for step in range(reuse * DRAWS))
            assert used == {begin + step: reuse for step in range(DRAWS)}


def test_windows_meet_others_in_each_pass():
    together = [
        {(drawing_step(step, 0, 3, 0), drawing_step(step, 1, 3, 0)) for step in range(begin, begin + DRAWS)}
        for begin in (0, DRAWS, 2 * DRAWS)
    ]
    assert len(together[1] & together[0]) < DRAWS / 4
    assert len(together[2] & together[1]) < DRAWS / 4


def test_without_reuse_every_step_draws_its_own():
    assert all(draws_afresh(step, 1) and drawing_step(step, 0, 1, 0) == step for step in range(3 * DRAWS))


def test_a_run_resumed_within_a_round_takes_the_same_steps(tmp_path):
    clouds = write_clouds(tmp_path / "tpc")
    sizes = {"width": 16, "heads": 2, "key_layers": 1, "fill_layers": 1, "frame_layers": 1}
    ae = write_random_weights(tmp_path / "weights") / "ae"
    config = Config(
        tpc=clouds, ae=ae, output=tmp_path / "lms", batch=2, window=12, points=16, synthesiser=sizes, reuse=2
    )

    def loss_of(task, step):
        batch = task.draw(step_random(0, 1, step, range(2)))
        assert isinstance(batch, AgainBatch) == (not draws_afresh(step, 2))
        return task.loss(batch, step_generator(0, 2, step, range(2), CPU))[0].item()

    with TpcReader(clouds) as reader:
        pools, models = window_pools(reader, config), load_autoencoder(ae, "cpu")
        unbroken, resumed = (SynthesiserTask(config, models, *pools, CPU) for _ in range(2))
        losses = [loss_of(unbroken, step) for step in range(DRAWS + 4)]
        assert losses[DRAWS + 2 :] == [loss_of(resumed, step) for step in (DRAWS + 2, DRAWS + 3)]
        assert max(len(unbroken.encoded), len(resumed.encoded)) <= DRAWS
        loss_of(unbroken, 2 * DRAWS)
        assert len(unbroken.encoded) == 1


def test_a_window_keeps_its_identities_and_what_the_decoder_makes_of_it(tmp_path):
    clouds = write_clouds(tmp_path / "tpc")
    sizes = {"width": 16, "heads": 2, "key_layers": 1, "fill_layers": 1, "frame_layers": 1}
    ae = write_random_weights(tmp_path / "weights") / "ae"
    config = Config(
        tpc=clouds, ae=ae, output=tmp_path / "lms", batch=2, window=12, points=16, synthesiser=sizes, reuse=2,
        mixed_precision=False,
    )  # fmt: skip
    with TpcReader(clouds) as reader:
        task = SynthesiserTask(config, load_autoencoder(ae, "cpu"), *window_pools(reader, config), CPU)
        held = task._latents_of(task.draw(step_random(0, 1, DRAWS + 3, range(2))))
    times = torch.arange(12.0).unsqueeze(0)
    for row in range(2):
        part = slice(row, row + 1)
        true, plain = (
            task.decoder(latents[part], centroids[part], times, held.groups[part], held.identities[part])
            for latents, centroids in ((held.latents, held.centroids), (held.base_latents, held.base_centroids))
        )
        torch.testing.assert_close(held.true_clouds[part], true)
        torch.testing.assert_close(held.base_squares[part], (plain - true).square().sum(-1).mean(-1))
    assert not torch.equal(held.identities[0], held.identities[1])
