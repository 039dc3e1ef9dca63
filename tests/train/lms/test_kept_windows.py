"""Windows that serve in several steps: far apart, in other company every time, the same after a resume."""

from collections import Counter
from dataclasses import fields

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from safetensors import SafetensorError

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import PumpsError
from data_schemas.tpc import TpcReader
from stages.shared.inference.models import load_autoencoder
from stages.shared.synthesiser_training.config import NewSizes
from stages.shared.synthesiser_training.fill_batch import FillBatch, KeptBatch
from stages.shared.synthesiser_training.kept_windows import KeptWindows, LatentBatch, Schedule
from stages.shared.synthesiser_training.task import SynthesiserTask
from stages.shared.training.stage import window_pools
from stages.shared.training.task import step_generator, step_random
from stages.shared.training.unfinished import Unfinished
from stages.train.lms.config import Config
from stages.train.lms.run import run
from tests.shared.inference.examples import write_random_weights
from tests.shared.training.tiny_clouds import write_clouds

CPU = torch.device("cpu")
SIZES = NewSizes(width=16, heads=2, key_layers=1, fill_layers=1, frame_layers=1)


@given(st.integers(1, 8), st.integers(1, 60), st.integers(0, 400), st.integers(0, 5))
def test_a_step_learns_from_what_was_drawn_before_and_is_still_kept(reuse, kept, step, row):
    schedule = Schedule(reuse, kept, seed=0)
    draws = [earlier for earlier in range(step + 1) if schedule.draws_afresh(earlier)]
    source = schedule.source(step, row)
    assert source in draws[-kept:]
    assert (source == step) == schedule.draws_afresh(step) or source < step
    assert schedule.oldest(step) <= source
    assert schedule.oldest(step) == draws[-kept:][0]


def test_windows_serve_about_as_often_as_said_and_far_apart():
    reuse, kept, steps = 4, 50, 4000
    schedule = Schedule(reuse, kept, seed=0)
    sources = [schedule.source(step, 0) for step in range(steps)]
    used = Counter(sources)
    steady = [used[step] for step in range(1000, steps - reuse * kept) if schedule.draws_afresh(step)]
    assert sum(steady) / len(steady) == pytest.approx(reuse, rel=0.05)
    last: dict[int, int] = {}
    gaps = []
    for step, source in enumerate(sources):
        if source in last:
            gaps.append(step - last[source])
        last[source] = step
    assert sorted(gaps)[len(gaps) // 2] > kept / 2  # steps until a window comes back, half of the times


def test_rows_meet_others_at_every_step():
    schedule = Schedule(3, 64, seed=0)
    steps = [step for step in range(300, 900) if not schedule.draws_afresh(step)]
    pairs = Counter((schedule.source(step, 0), schedule.source(step, 1)) for step in steps)
    assert pairs.most_common(1)[0][1] <= 2


def test_without_reuse_every_step_draws_its_own():
    schedule = Schedule(1, 16, seed=0)
    assert all(schedule.draws_afresh(step) and schedule.source(step, 0) == step for step in range(100))


def made_up_batch(rows=3, frames=5, points=4):
    random = torch.Generator().manual_seed(0)

    def normal(*shape):
        return torch.randn(*shape, generator=random)

    return LatentBatch(
        normal(rows, frames, 6), normal(rows, frames, 3), normal(rows, frames, 6), normal(rows, frames, 3),
        torch.randint(0, 5, (rows, points), generator=random), torch.rand(rows, frames, generator=random) < 0.5,
        torch.ones(rows, frames, dtype=torch.bool), normal(rows, points, 2), normal(rows, frames, points, 3),
        normal(rows, frames).square(),
    )  # fmt: skip


def test_what_is_kept_comes_back_row_by_row(tmp_path):
    kept, first = KeptWindows(tmp_path / "windows"), made_up_batch()
    second = LatentBatch(*(getattr(first, each.name).flip(0) for each in fields(first)))
    kept.put(0, range(3), first)
    kept.put(7, range(3), second)
    found = kept.take([0, 7, 0], range(3))
    for each in fields(LatentBatch):
        value, rows = getattr(found, each.name), [getattr(first, each.name)[row] for row in (0, 1, 2)]
        assert value.dtype == getattr(first, each.name).dtype
        torch.testing.assert_close(value, torch.stack(rows), atol=2e-3, rtol=1e-3)
    kept.forget_before(7)
    assert not kept.holds(0, range(3)) and kept.holds(7, range(3))


def test_a_disk_that_takes_no_more_is_said_in_a_sentence(tmp_path, monkeypatch):
    def full(*_):
        raise SafetensorError("No space left on device")

    monkeypatch.setattr("stages.shared.synthesiser_training.kept_windows.save_file", full)
    with pytest.raises(PumpsError, match="No space left"):
        KeptWindows(tmp_path / "windows").put(0, range(3), made_up_batch())


def config_of(folder, **more):
    return Config(
        tpc=write_clouds(folder / "tpc"), ae=write_random_weights(folder / "weights") / "ae", output=folder / "lms",
        batch=2, window=12, points=16, synthesiser=SIZES, reuse=2, kept_windows=16, **more,
    )  # fmt: skip


def loss_of(task, step):
    batch = task.draw(step_random(0, 1, step, range(2)))
    assert isinstance(batch, FillBatch) == task.schedule.draws_afresh(step)
    return task.loss(batch, step_generator(0, 2, step, range(2), CPU))[0].item()


@pytest.mark.parametrize("lost", [False, True])
def test_a_resumed_run_takes_the_same_steps(tmp_path, lost):
    config = config_of(tmp_path)
    with TpcReader(config.tpc) as reader:
        pools, models = window_pools(reader, config), load_autoencoder(config.ae, "cpu")
        unbroken, resumed = (SynthesiserTask(config, models, *pools, CPU) for _ in range(2))
        losses = [loss_of(unbroken, step) for step in range(24)]
        if lost:  # a window that is not there any more is drawn and encoded again
            for path in unbroken.kept.folder.iterdir():
                path.unlink()
        assert losses[20:] == [loss_of(resumed, step) for step in range(20, 24)]


def test_what_no_step_needs_any_more_is_removed(tmp_path):
    config = config_of(tmp_path, checkpoint_every=1)
    with TpcReader(config.tpc) as reader:
        task = SynthesiserTask(config, load_autoencoder(config.ae, "cpu"), *window_pools(reader, config), CPU)
        for step in range(60):
            loss_of(task, step)
        assert len(list(task.kept.folder.iterdir())) <= 10


def test_a_process_that_draws_ahead_encodes_what_the_steps_learn_from(tmp_path):
    config = config_of(tmp_path, steps=10, validate_every=5, checkpoint_every=5, mixed_precision=False)
    losses, threads = [], torch.get_num_threads()
    for workers in (0, 1):
        output = tmp_path / f"lms{workers}"
        run(config.model_copy(update={"workers": workers, "output": output}))
        losses.append([row["loss"] for row in read_checkpoint(output).log if row["split"] == "train"])
        assert not Unfinished(config.model_copy(update={"output": output})).folder.exists()
    assert losses[0] and losses[0] == pytest.approx(losses[1], rel=1e-4)
    assert torch.get_num_threads() == threads


def test_another_seed_trains_on_other_windows_and_is_measured_on_the_same(tmp_path):
    config = config_of(tmp_path)
    with TpcReader(config.tpc) as reader:
        pools, models = window_pools(reader, config), load_autoencoder(config.ae, "cpu")
        tasks = [SynthesiserTask(config.model_copy(update={"seed": seed}), models, *pools, CPU) for seed in (0, 1)]
        drawn = [task.draw(step_random(task.config.seed, 1, 0, range(2))) for task in tasks]
        assert not torch.equal(drawn[0].points, drawn[1].points)
        for (name, one), (other_name, other) in zip(tasks[0].held_back, tasks[1].held_back, strict=True):
            assert name == other_name
            assert torch.equal(one.points, other.points) and torch.equal(one.known, other.known)


def test_a_window_keeps_its_identities_and_what_the_decoder_makes_of_it(tmp_path):
    config = config_of(tmp_path, mixed_precision=False)
    with TpcReader(config.tpc) as reader:
        task = SynthesiserTask(config, load_autoencoder(config.ae, "cpu"), *window_pools(reader, config), CPU)
        batch = task.draw(step_random(0, 1, 9, range(2)))
        assert isinstance(batch, KeptBatch)
        held = task._latents_of(batch)
    times = torch.arange(12.0).unsqueeze(0)
    for row in range(2):
        part = slice(row, row + 1)
        true, plain = (
            task.frozen.decoder(latents[part], centroids[part], times, held.groups[part], held.identities[part])
            for latents, centroids in ((held.latents, held.centroids), (held.base_latents, held.base_centroids))
        )
        torch.testing.assert_close(held.true_clouds[part], true, atol=2e-3, rtol=1e-3)  # kept in half precision
        torch.testing.assert_close(
            held.base_squares[part], (plain - true).square().sum(-1).mean(-1), atol=2e-3, rtol=1e-2
        )
    assert not torch.equal(held.identities[0], held.identities[1])
