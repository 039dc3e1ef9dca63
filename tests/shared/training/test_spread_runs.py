"""A batch is the same batch in parts, in several processes, and drawn by others."""

import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import torch

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError, UsageError
from data_schemas.tpc import TpcReader
from stages.shared.networks.layers.row_generator import draw_normal, draw_uniform
from stages.shared.progress import SILENT
from stages.shared.training.batches import drawn_ahead, parts_of
from stages.shared.training.loop import train
from stages.shared.training.ranks import Ranks
from stages.shared.training.stage import window_pools
from stages.shared.training.task import step_generator, step_random
from stages.train.ae.config import Config
from stages.train.ae.run import run
from stages.train.ae.task import AutoencoderTask
from tests.shared.training.small_trainings import Parabola, plain_config
from tests.shared.training.tiny_clouds import write_clouds
from tests.shared.training.tiny_runs import TINY, figures_of, start_training, weights_of

EXACT = {"mixed_precision": False, "batch": 5, "steps": 10, "validate_every": 5}


@pytest.fixture(scope="module")
def clouds(tmp_path_factory):
    return write_clouds(tmp_path_factory.mktemp("clouds") / "tpc")


@pytest.fixture(scope="module")
def whole(clouds, tmp_path_factory):
    """One process, whole batches."""
    output = tmp_path_factory.mktemp("whole") / "ae"
    run(Config(tpc=clouds, output=output, **{**TINY, **EXACT}))
    return output


def assert_same_training(one, other):
    """The same figures and weights, except for rounding."""
    for mine, its in zip(figures_of(one), figures_of(other), strict=True):
        assert mine.pop("split") == its.pop("split")
        assert mine == pytest.approx(its, rel=1e-4)
    mine, its = weights_of(one), weights_of(other)
    assert all(np.abs(mine[name] - its[name]).max() < 1e-4 for name in mine)


def test_two_processes_train_as_one_and_only_the_first_writes_and_reports(clouds, whole, tmp_path):
    spread = start_training(clouds, tmp_path / "ae", processes=2, **EXACT)
    said, _ = spread.communicate(timeout=180)
    assert spread.returncode == 0, said
    assert said.count("step 5:") == said.count("step 10:") == said.count("best validation score") == 1
    assert_same_training(tmp_path / "ae", whole)


def test_a_folder_that_holds_another_package_called_stages_does_no_harm(clouds, whole, tmp_path):
    """The training imports its own packages, not those of the folder that it is started from; so do its workers."""
    own = tmp_path / "stages"
    own.mkdir()
    (own / "__init__.py").write_text("raise ImportError('these are other stages')\n")
    spread = start_training(clouds, tmp_path / "ae", processes=2, folder=tmp_path, **EXACT, workers=1)
    said, _ = spread.communicate(timeout=180)
    assert spread.returncode == 0, said
    assert_same_training(tmp_path / "ae", whole)


@pytest.mark.parametrize("changes", [{"accumulate": 2}, {"accumulate": 5}, {"activation_checkpointing": True}])
def test_parts_and_computing_again_change_nothing_but_rounding(clouds, whole, tmp_path, changes):
    run(Config(tpc=clouds, output=tmp_path / "ae", **{**TINY, **EXACT, **changes}))
    assert_same_training(tmp_path / "ae", whole)


@pytest.mark.skipif(
    not Path(f"/proc/self/task/{os.getpid()}/children").exists(), reason="finds processes as Linux lists them"
)
def test_a_process_that_dies_ends_them_all(clouds, tmp_path):
    spread = start_training(clouds, tmp_path / "ae", processes=2, **{**EXACT, "steps": 100_000})
    deadline = time.monotonic() + 120
    while not (tmp_path / "ae.partial" / "checkpoints").exists():
        assert spread.poll() is None and time.monotonic() < deadline
        time.sleep(0.05)
    children = Path(f"/proc/{spread.pid}/task/{spread.pid}/children").read_text().split()
    trainers = [int(child) for child in children if b"train\0ae" in Path(f"/proc/{child}/cmdline").read_bytes()]
    assert len(trainers) == 2
    os.kill(trainers[1], signal.SIGKILL)
    spread.communicate(timeout=180)
    assert spread.returncode != 0
    assert not any(Path(f"/proc/{child}").exists() for child in trainers)


def test_too_few_windows_for_all_parts_are_refused(tmp_path):
    with pytest.raises(UsageError, match="batch of 3 windows cannot be split into 4 parts"):
        parts_of(plain_config(tmp_path, batch=3, accumulate=2), Ranks(0, 2), True)


def test_drawing_processes_draw_what_a_thread_draws(clouds, tmp_path):
    config = Config(tpc=clouds, output=tmp_path / "ae", **{**TINY, "steps": 3, "batch": 3})
    with TpcReader(clouds) as reader:
        task = AutoencoderTask(config, *window_pools(reader, config), torch.device("cpu"))
        drawn = [
            list(drawn_ahead(task, config.model_copy(update={"workers": workers}), [range(2), range(2, 3)], 1))
            for workers in (0, 1)
        ]
    assert len(drawn[0]) == len(drawn[1]) == 4  # two parts of two steps
    for here, there in zip(*drawn, strict=True):
        assert (here.points == there.points).all() and (here.groups == there.groups).all()


@pytest.mark.parametrize(("processes", "accumulate"), [(1, 1), (1, 3), (2, 2), (3, 1)])
def test_the_parts_of_all_processes_make_up_the_batch(tmp_path, processes, accumulate):
    config = plain_config(tmp_path, batch=7, accumulate=accumulate)
    parts = [part for rank in range(processes) for part in parts_of(config, Ranks(rank, processes), True)]
    assert [row for part in parts for row in part] == list(range(7))


def test_a_task_that_cannot_split_batches_is_refused(tmp_path):
    with pytest.raises(UsageError, match="cannot split its batches"):
        train(Parabola(), plain_config(tmp_path, accumulate=2), progress=SILENT)


def test_a_window_draws_the_same_whichever_others_are_drawn_beside_it():
    whole, part = step_random(3, 1, 8, range(6)), step_random(3, 1, 8, range(4, 6))
    assert [row.random() for row in whole.rows[4:]] == [row.random() for row in part.rows]
    assert len({row.random() for row in (*whole.rows, whole)}) == 7  # no two alike, nor like the whole's
    cpu = torch.device("cpu")
    for draw in (draw_normal, draw_uniform):
        six, two = (step_generator(3, 2, 8, rows, cpu) for rows in (range(6), range(4, 6)))
        assert (draw((6, 5), six, cpu)[4:] == draw((2, 5), two, cpu)).all()


def test_a_training_starts_from_a_finished_one_and_its_optimiser(clouds, tmp_path):
    first = Config(tpc=clouds, output=tmp_path / "first", **{**TINY, "keep_optimiser": True})
    run(first)
    kept = read_checkpoint(first.output)
    assert kept.optimiser is not None
    assert {name.split("/")[0] for name in kept.optimiser} == {"step", "exp_avg", "exp_avg_sq"}
    # With a rate of nothing it ends with the weights that it started from.
    still = {**TINY, "initial": first.output, "learning_rate": 0.0, "keep_optimiser": True}
    run(Config(tpc=clouds, output=tmp_path / "second", **still))
    again = read_checkpoint(tmp_path / "second")
    assert all(np.abs(again.weights[name] - kept.weights[name]).max() < 1e-6 for name in kept.weights)
    assert again.optimiser is not None
    assert {int(value) for name, value in again.optimiser.items() if name.startswith("step/")} == {12}
    assert [each.steps for each in again.trainings] == [6, 6]
    assert {each.data.sentence for each in again.trainings if each.data} == {kept.trainings[0].data.sentence}
    assert "Started from: weights of 6 steps" in again.card and str(tmp_path) not in again.card

    other = {**TINY, "initial": first.output, "encoder": {**TINY["encoder"], "width": 4}}
    with pytest.raises(InputError, match="this network has"):
        run(Config(tpc=clouds, output=tmp_path / "third", **other))
