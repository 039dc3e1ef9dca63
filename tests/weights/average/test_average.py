"""The mean of several trainings from the same weights, and what may not be averaged."""

import numpy as np
import pytest

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.checkpoint import read_checkpoint, write_checkpoint
from data_schemas.errors import InputError
from stages.weights.average.config import Config
from stages.weights.average.run import run

CONFIG = {"network": "synthesiser", "encoder_digest": "a", "trained_on": "3 clips, from a.zip"}
FIRST, ONE, TWO = ({"steps": steps, "minutes": 1.0} for steps in (10, 20, 30))


def write(path, weights, **config):
    with write_artefact(path, "checkpoint", stage="train-lms", config={}, licences=[f"of {path.name}"]) as draft:
        write_checkpoint(
            draft.folder, weights=weights, config={**CONFIG, **config}, optimiser=None,
            log=[{"step": 7, "seconds": 60.0, "split": "train"}], card="",
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
    assert found.config == {**CONFIG, "trainings": [FIRST, ONE, TWO]}
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
    (own,) = found.config["trainings"]
    assert (own["steps"], own["minutes"]) == (7, 1.0)  # what their log says of the one training


@pytest.mark.parametrize("change", ["network", "encoder_digest", "trained_on"])
def test_other_networks_encoders_and_data_are_refused(weights, tmp_path, change):
    places = write(tmp_path / "one", weights), write(tmp_path / "two", near(weights, 1), **{change: "other"})
    with pytest.raises(InputError, match="another network"):
        run(Config(checkpoints=places, output=tmp_path / "mean"))
    assert not (tmp_path / "mean").exists()


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
