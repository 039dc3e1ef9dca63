"""A training that is killed resumes where it was, and ends with the same result."""

import random
import signal
import time

import pyarrow.parquet as pq
import pytest
import torch

from data_schemas.artefact import partial_folder
from stages.shared.progress import SILENT
from stages.shared.training.log import TrainingLog
from stages.train.ae.config import Config
from stages.train.ae.run import run
from tests.shared.training.tiny_clouds import write_clouds
from tests.shared.training.tiny_runs import TINY, figures_of, start_training, weights_of

SETTINGS = {"steps": 50, "validate_every": 20, "checkpoint_every": 5}


@pytest.fixture(autouse=True)
def one_thread():
    """Sums are rounded alike in this process and in the one that is killed."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


class Heard:
    """A progress that keeps the messages."""

    def __init__(self):
        self.messages = []

    def start(self, label, total=None): ...
    def advance(self, steps=1, note=""): ...

    def message(self, text):
        self.messages.append(text)


def whole_checkpoints(output):
    return sorted(partial_folder(output).glob("checkpoints/step_*/manifest.json"))


def test_a_run_killed_at_any_moment_ends_as_the_unbroken_one(tmp_path):
    clouds = write_clouds(tmp_path / "tpc")
    killed = start_training(clouds, tmp_path / "killed", **SETTINGS)
    deadline = time.monotonic() + 120
    while not whole_checkpoints(tmp_path / "killed"):
        assert killed.poll() is None and time.monotonic() < deadline, killed.communicate()[0]
        time.sleep(0.005)
    time.sleep(random.uniform(0, 0.4))  # in the middle of a step, of a checkpoint's writing, between two
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    assert killed.returncode == -signal.SIGKILL

    heard = Heard()
    for name, progress in (("killed", heard), ("whole", SILENT)):
        run(Config(tpc=clouds, output=tmp_path / name, **{**TINY, **SETTINGS}), progress=progress)
    assert "going on from step" in heard.messages[0]
    ended, whole = weights_of(tmp_path / "killed"), weights_of(tmp_path / "whole")
    assert all((ended[name] == whole[name]).all() for name in whole)
    assert figures_of(tmp_path / "killed") == figures_of(tmp_path / "whole")
    assert not partial_folder(tmp_path / "killed").exists()


def test_a_damaged_checkpoint_costs_the_steps_since_the_one_before_it(tmp_path):
    clouds = write_clouds(tmp_path / "tpc")
    config = Config(tpc=clouds, output=tmp_path / "ae", **{**TINY, "steps": 8, "keep_checkpoints": 2})
    assert not run(config.model_copy(update={"max_time": 1e-9})).figures["finished"]  # one step, then a checkpoint
    assert [path.parent.name for path in whole_checkpoints(config.output)] == ["step_000000001"]
    assert not run(config.model_copy(update={"max_time": 1e-9})).figures["finished"]
    assert not run(config.model_copy(update={"max_time": 1e-9})).figures["finished"]
    kept = whole_checkpoints(config.output)
    assert [path.parent.name for path in kept] == ["step_000000002", "step_000000003"]
    next(kept[1].parent.glob("data-*/model.safetensors")).write_bytes(b"")
    heard = Heard()
    assert run(config, progress=heard).figures["finished"]
    assert any("going on from step 2." in message for message in heard.messages)
    run(config.model_copy(update={"output": tmp_path / "whole"}))
    ended, whole = weights_of(tmp_path / "ae"), weights_of(tmp_path / "whole")
    assert all((ended[name] == whole[name]).all() for name in whole)


def test_the_log_is_on_the_disk_in_parts_before_a_checkpoint_holds_it(tmp_path):
    config = Config(tpc=tmp_path, output=tmp_path / "ae")
    log = TrainingLog(config, tmp_path / "log", [])
    log.add("train", 20, 1.0, {"loss": 2.0})
    log.add("val", 20, 1.5, {"score": 1.0})
    log.save_part()
    log.add("train", 40, 2.0, {"loss": 1.5})
    log.save_part()
    parts = [pq.read_table(path).to_pylist() for path in sorted((tmp_path / "log").iterdir())]
    assert [row["step"] for part in parts for row in part] == [20, 20, 40]
    log.forget_parts()
    assert not (tmp_path / "log").exists()


def test_tensorboard_shows_training_and_validation(tmp_path):
    events = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    clouds = write_clouds(tmp_path / "tpc")
    run(Config(tpc=clouds, output=tmp_path / "ae", **{**TINY, "tensorboard": True}))
    board = events.EventAccumulator(str(tmp_path / "ae.tensorboard"))
    board.Reload()
    names = board.Tags()["scalars"]
    assert {"train/loss", "train/gradient_norm", "train/learning_rate", "val/score", "val/rec_mm"} <= set(names)
    assert [event.step for event in board.Scalars("val/rec_mm")] == [3, 6]
