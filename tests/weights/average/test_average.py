"""The mean of several trainings from the same weights, and what may not be averaged."""

import numpy as np
import pytest

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.checkpoint import read_checkpoint, write_checkpoint
from data_schemas.errors import InputError
from data_schemas.trainings import TrainedArchive, Training, TrainingData
from stages.weights.average.config import Config
from stages.weights.average.run import run

CONFIG = {"network": "synthesiser", "encoder_digest": "a"}
DATA = TrainingData(clips=3, seconds=60.0, skeletons=1, archives=[TrainedArchive(name="a.zip", sha256="1" * 64)])
FIRST, ONE, TWO = (Training(steps=steps, minutes=1.0, data=DATA) for steps in (10, 20, 30))


def write(path, weights, trainings=(FIRST,), **config):
    with write_artefact(path, "checkpoint", stage="train-lms", config={}, licences=[f"of {path.name}"]) as draft:
        write_checkpoint(
            draft.folder, weights=weights, config={**CONFIG, **config}, optimiser=None,
            log=[], card="", trainings=trainings,
        )  # fmt: skip
    return path


def near(weights, seed):
    rng = np.random.default_rng(seed)
    return {
        name: (value + 0.1 * rng.standard_normal(value.shape)).astype(np.float32) for name, value in weights.items()
    }


@pytest.fixture
def weights():
    rng = np.random.default_rng(0)
    return {"a": rng.standard_normal((20, 30)).astype(np.float32), "b": rng.standard_normal(5).astype(np.float32)}


def test_the_mean_of_weights_with_their_licences_and_trainings(weights, tmp_path):
    places = [
        write(tmp_path / "one", near(weights, 1), trainings=[FIRST, ONE]),
        write(tmp_path / "two", near(weights, 2), trainings=[FIRST, TWO]),
        write(tmp_path / "three", near(weights, 3), trainings=[FIRST]),
    ]
    report = run(Config(checkpoints=tuple(places), output=tmp_path / "mean"))
    made = open_artefact(tmp_path / "mean", "checkpoint")
    found = read_checkpoint(made)
    for name in weights:
        assert found.weights[name].dtype == np.float32
        every = [read_checkpoint(place).weights[name].astype(float) for place in places]
        np.testing.assert_allclose(found.weights[name], sum(every) / 3, rtol=1e-6, atol=1e-7)
    assert found.config == CONFIG and found.trainings == (FIRST, ONE, TWO)
    assert made.manifest.licences == ["of one", "of three", "of two"]
    assert all(licence in found.card for licence in made.manifest.licences)
    assert [each.digest for each in made.manifest.inputs] == [
        open_artefact(place).manifest.digest for place in places
    ]
    assert report.figures["checkpoints"] == 3 and 0 < report.figures["apart"] < 0.15
    assert str(tmp_path) not in found.card


def test_the_mean_of_one_and_the_same_is_itself(weights, tmp_path):
    place = write(tmp_path / "one", weights)
    assert run(Config(checkpoints=(place, place, place), output=tmp_path / "mean")).figures["apart"] < 1e-6
    found = read_checkpoint(tmp_path / "mean")
    assert all(np.abs(found.weights[name] - weights[name]).max() < 1e-6 for name in weights)
    assert found.trainings == (FIRST,)


def on(**changes):
    return {"trainings": (Training(steps=10, minutes=1.0, data=DATA.model_copy(update=changes)),)}


OTHERS = {
    "network": {"network": "other"},
    "encoder": {"encoder_digest": "other"},
    "more clips": on(clips=4),
    "another archive": on(archives=[TrainedArchive(name="b.zip")]),
    "an archive of the same name": on(archives=[TrainedArchive(name="a.zip", sha256="2" * 64)]),
    "data that nobody knows": {"trainings": ()},
}


@pytest.mark.parametrize("change", OTHERS)
def test_other_networks_encoders_and_data_are_refused(weights, tmp_path, change):
    places = write(tmp_path / "one", weights), write(tmp_path / "two", near(weights, 1), **OTHERS[change])
    with pytest.raises(InputError, match="another network"):
        run(Config(checkpoints=places, output=tmp_path / "mean"))
    assert not (tmp_path / "mean").exists()


def test_a_training_on_other_data_is_averaged_with_its_start(weights, tmp_path):
    further = on(clips=4)["trainings"]
    places = (
        write(tmp_path / "end", near(weights, 1), trainings=(FIRST, *further)),
        write(tmp_path / "begin", weights),
    )
    run(Config(checkpoints=places, output=tmp_path / "mean"))
    assert read_checkpoint(tmp_path / "mean").trainings == (FIRST, *further)


def test_weights_that_do_not_know_the_content_of_their_archives_are_averaged_with_ones_that_do(weights, tmp_path):
    places = (
        write(tmp_path / "one", weights),
        write(tmp_path / "two", near(weights, 1), **on(archives=[TrainedArchive(name="a.zip")])),
    )
    assert run(Config(checkpoints=places, output=tmp_path / "mean")).figures["checkpoints"] == 2


@pytest.mark.parametrize("value", ["far", "no number"])
def test_weights_that_average_to_nothing_are_refused(weights, tmp_path, value):
    rng = np.random.default_rng(5)
    other = {name: rng.standard_normal(each.shape).astype(np.float32) for name, each in weights.items()}
    if value == "no number":
        other = {name: np.full_like(each, np.nan) for name, each in weights.items()}
    places = write(tmp_path / "one", weights), write(tmp_path / "two", other)
    with pytest.raises(InputError, match="from their mean"):
        run(Config(checkpoints=places, output=tmp_path / "mean"))


def test_arrays_of_other_shapes_are_refused(weights, tmp_path):
    other = {**weights, "a": weights["a"][:10]}
    places = write(tmp_path / "one", weights), write(tmp_path / "two", other)
    with pytest.raises(InputError, match="another network"):
        run(Config(checkpoints=places, output=tmp_path / "mean"))
