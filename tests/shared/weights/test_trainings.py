"""What weights were trained on is told of all trainings that they went through, not of the last alone."""

from data_schemas.checkpoint import Checkpoint
from stages.shared.weights.trainings import data_of, trainings_of


def kept(log=(), **config):
    return Checkpoint(weights={}, config=config, optimiser=None, log=list(log), card="")


def test_weights_that_went_on_from_others_were_trained_on_both_data():
    first = {"steps": 5, "minutes": 1.0, "trained_on": "9 clips, from a.zip"}
    last = {"steps": 7, "minutes": 2.0, "trained_on": "3 clips, from b.zip"}
    found = kept(trained_on="3 clips, from b.zip", trainings=[first, last])
    assert trainings_of(found) == [first, last]
    assert data_of(found) == ["3 clips, from b.zip", "9 clips, from a.zip"]


def test_older_weights_tell_of_their_last_training_by_their_log():
    found = kept([{"step": 3, "seconds": 60.0}, {"step": 8, "seconds": 186.0}], trained_on="3 clips, from b.zip")
    assert trainings_of(found) == [{"steps": 8, "minutes": 3.1, "trained_on": "3 clips, from b.zip"}]
    assert data_of(found) == ["3 clips, from b.zip"]
    assert data_of(kept()) == []
