"""The training loop: a resumed run is the unbroken one, a kill costs nothing, bad losses stop it."""

from __future__ import annotations

import math
import shutil

import pytest

from data_schemas.artefact import open_artefact, partial_folder
from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import PumpsError
from stages.shared.progress import SILENT
from stages.shared.training.config import TrainingConfig
from stages.shared.training.loop import learning_rate, train
from stages.train.ae.config import Config
from stages.train.ae.run import run
from tests.shared.training.small_trainings import Bar, KillAt, Killed, Parabola, plain_config
from tests.shared.training.tiny_clouds import write_clouds
from tests.shared.training.tiny_runs import TINY, weights_of


@pytest.fixture(scope="module")
def clouds(tmp_path_factory):
    return write_clouds(tmp_path_factory.mktemp("clouds") / "tpc")


def config_for(clouds, output, **changes) -> Config:
    return Config(tpc=clouds, output=output, **{**TINY, **changes})


@pytest.mark.parametrize("optimiser", ["adamw", "muon"])
def test_a_killed_run_resumes_bit_for_bit(clouds, tmp_path, optimiser):
    run(config_for(clouds, tmp_path / "whole", optimiser=optimiser))
    with pytest.raises(Killed):
        run(config_for(clouds, tmp_path / "broken", optimiser=optimiser), progress=KillAt(5))
    kept = sorted(path.name for path in (partial_folder(tmp_path / "broken") / "checkpoints").iterdir())
    assert kept == ["step_000000002", "step_000000004"]
    assert not (tmp_path / "broken" / "manifest.json").exists()
    report = run(config_for(clouds, tmp_path / "broken", optimiser=optimiser))
    assert report.figures["finished"]
    whole, broken = weights_of(tmp_path / "whole"), weights_of(tmp_path / "broken")
    assert all((whole[name] == broken[name]).all() for name in whole)
    steps = [row["step"] for row in read_checkpoint(tmp_path / "broken").log if row["split"] == "val"]
    assert steps == [3, 6]
    assert not partial_folder(tmp_path / "broken").exists()


def test_another_config_does_not_resume_the_old_run(clouds, tmp_path):
    with pytest.raises(Killed):
        run(config_for(clouds, tmp_path / "ae"), progress=KillAt(4))
    run(config_for(clouds, tmp_path / "ae", seed=5))
    run(config_for(clouds, tmp_path / "fresh", seed=5))
    old, fresh = weights_of(tmp_path / "ae"), weights_of(tmp_path / "fresh")
    assert all((old[name] == fresh[name]).all() for name in old)


def test_a_run_goes_on_where_its_data_were_moved_but_not_with_other_data(clouds, tmp_path):
    said = []

    class Told(KillAt):
        def message(self, text):
            said.append(text)

    with pytest.raises(Killed):
        run(config_for(clouds, tmp_path / "ae"), progress=KillAt(4))
    shutil.copytree(clouds, tmp_path / "moved")
    with pytest.raises(Killed):
        run(config_for(tmp_path / "moved", tmp_path / "ae"), progress=Told(1))
    assert any("going on from step" in text for text in said)
    others = write_clouds(tmp_path / "others", clips=4)
    with pytest.raises(Killed):
        run(config_for(others, tmp_path / "ae"), progress=Told(1))
    assert any("other settings (tpc)" in text and "starting afresh" in text for text in said)
    # Hours of training are not thrown away for a flag: put back, it goes on with its own settings.
    aside = tmp_path / "ae.set-aside"
    assert sorted(path.name for path in (aside / "checkpoints").iterdir())
    shutil.rmtree(partial_folder(tmp_path / "ae"), ignore_errors=True)
    aside.rename(partial_folder(tmp_path / "ae"))
    said.clear()
    with pytest.raises(Killed):
        run(config_for(clouds, tmp_path / "ae"), progress=Told(1))
    assert any("going on from step" in text for text in said)


def test_a_run_stopped_by_max_time_can_be_resumed(clouds, tmp_path):
    report = run(config_for(clouds, tmp_path / "ae", max_time=1e-9))
    assert not report.figures["finished"]
    assert report.figures["step"] == 1
    assert not (tmp_path / "ae").exists() or not (tmp_path / "ae" / "manifest.json").exists()
    assert run(config_for(clouds, tmp_path / "ae")).figures["finished"]


def test_the_checkpoint_says_what_it_was_trained_on(clouds, tmp_path):
    run(config_for(clouds, tmp_path / "ae", steps=2))
    artefact = open_artefact(tmp_path / "ae", "checkpoint")
    assert artefact.manifest.licences == ["CC0"]
    kept = read_checkpoint(artefact)
    assert "CC0" in kept.card and "archive0.zip" in kept.card
    measured = next(row for row in kept.log if row["split"] == "val")
    assert f"| rec_mm | {measured['rec_mm']:.5g} |" in kept.card


@pytest.mark.parametrize(
    "changes", [{"loss": "chamfer"}, {"loss_points": 8}, {"decoder": {**TINY["decoder"], "head": "skinning"}}]
)
def test_the_choices_of_the_loss_and_head_train(clouds, tmp_path, changes):
    run(config_for(clouds, tmp_path / "ae", steps=2, **changes))
    losses = [row["loss"] for row in read_checkpoint(tmp_path / "ae").log if row["split"] == "train"]
    assert all(math.isfinite(loss) for loss in losses)


def test_it_descends_and_keeps_the_best(tmp_path):
    trained = train(Parabola(), plain_config(tmp_path), progress=SILENT)
    assert trained.finished
    assert abs(trained.weights["place"].item() - 3) < 0.3
    assert trained.best == min(row["score"] for row in trained.log if row["split"] == "val")


class Rising(Parabola):
    """A task whose score gets worse with every validation."""

    def __init__(self, keeps_last: bool):
        super().__init__()
        self._keeps_last = keeps_last

    @property
    def keeps_last(self) -> bool:
        return self._keeps_last

    def validate(self):
        return {"score": float(self.steps)}


def test_a_task_may_keep_its_last_weights_though_earlier_ones_were_better(tmp_path):
    config = {"steps": 60, "validate_every": 20, "average": 0.0}
    best, last = (
        train(Rising(kept), plain_config(tmp_path / str(kept), **config), progress=SILENT) for kept in (False, True)
    )
    assert (best.best_step, last.best_step) == (20, 60)
    assert abs(last.weights["place"].item() - 3) < abs(best.weights["place"].item() - 3)


def test_it_stops_early_when_nothing_gets_better(tmp_path):
    task = Parabola()
    task.validate = lambda: {"score": 1.0}
    trained = train(task, plain_config(tmp_path, patience=2), progress=SILENT)
    assert trained.finished
    assert trained.step == 60


def test_a_loss_that_is_no_number_stops_with_the_mend(tmp_path):
    with pytest.raises(PumpsError, match=r"nan at step 4.*learning_rate"):
        train(Parabola(poison_at=5), plain_config(tmp_path), progress=SILENT)


def test_the_learning_rate_warms_up_and_falls_to_nothing():
    config = TrainingConfig(output="nowhere", steps=100, warmup=10, learning_rate=1.0)
    rates = [learning_rate(config, step) for step in range(100)]
    assert rates[0] == pytest.approx(0.1)
    assert max(rates) == rates[9] == pytest.approx(1.0)
    assert rates[50] == pytest.approx((10 / 51) ** 0.5)
    assert rates[99] < 0.05


def test_minutes_end_a_training_whatever_its_steps(clouds, tmp_path):
    report = run(config_for(clouds, tmp_path / "ae", minutes=1e-6))
    assert report.figures["finished"] and report.figures["step"] == 1
    assert [row["split"] for row in read_checkpoint(tmp_path / "ae").log] == ["train", "val"]
    assert "score" in report.figures["val"]


def test_steps_do_not_end_a_training_of_minutes(clouds, tmp_path):
    seconds = Bar()
    report = run(config_for(clouds, tmp_path / "ae", steps=1, minutes=0.02), progress=seconds)
    assert report.figures["finished"] and report.figures["step"] > 1
    assert seconds.total == pytest.approx(1.2) and seconds.done == pytest.approx(report.figures["seconds"])


def test_minutes_are_counted_over_all_calls(clouds, tmp_path):
    settings = {"steps": 400, "minutes": 0.05, "validate_every": 400}
    calls = 1
    while not run(config_for(clouds, tmp_path / "ae", max_time=0.01, **settings)).figures["finished"]:
        calls += 1
        assert calls < 40
    assert calls > 1
    rows = [row for row in read_checkpoint(tmp_path / "ae").log if row["split"] == "train"]
    assert 3 <= rows[-1]["seconds"] < 20


def test_the_rate_falls_to_zero_towards_the_end_of_the_minutes(tmp_path):
    config = TrainingConfig(output=tmp_path, steps=1000, learning_rate=1.0, warmup=1, cooldown=0.5, minutes=10)
    rates = [learning_rate(config, 3, seconds) for seconds in (0, 299, 450, 600, 700)]
    assert rates == pytest.approx([0.5, 0.5, 0.25, 0, 0], abs=2e-3)
