"""Weights of one task: packed to half their size, listed and shown."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError
from stages.shared.weights.facts import task_facts_of
from stages.shared.weights.task_weights import is_of_task, shipped_task_weights, task_weights
from stages.weights.list.config import Config as ListConfig
from stages.weights.list.run import run as listed
from stages.weights.pack.config import Config
from stages.weights.pack.run import run
from stages.weights.show.config import Config as ShowConfig
from stages.weights.show.run import run as show


def test_the_lifter_ships_and_is_listed():
    assert "lifter" in shipped_task_weights() and is_of_task("lifter") and not is_of_task("tiny")
    facts = task_facts_of("lifter")
    assert facts["task"] == "estimate" and facts["corruption"] == "detector" and facts["joints"] == 31
    assert facts["bytes"] < 8e6 and facts["licences"]
    assert any(line.startswith("lifter") for line in listed(ListConfig()).lines)
    assert "estimate" in "\n".join(show(ShowConfig(name="lifter")).lines)


def test_packed_again_they_are_the_same_weights(tmp_path: Path):
    run(Config(run=task_weights("lifter"), output=tmp_path / "mine"))
    one, other = read_checkpoint(task_weights("lifter")), read_checkpoint(tmp_path / "mine")
    assert one.config == other.config
    for name, value in one.weights.items():
        assert value.dtype == np.float16
        np.testing.assert_array_equal(value, other.weights[name])


def test_weights_that_are_not_there():
    with pytest.raises(InputError, match="nothing: neither"):
        task_weights("nothing")
