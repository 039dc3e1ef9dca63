"""A checkpoint whose config asks for a network that its weights do not hold is refused before memory is taken."""

from __future__ import annotations

import json

import pytest

from data_schemas.errors import InputError
from data_schemas.manifest import open_artefact
from stages.shared.inference.models import load_autoencoder, load_weights
from tests.data_schemas.examples import peak_mb
from tests.shared.inference.examples import write_random_weights

CHANGES = [
    ("ae", ("encoder", "width"), 10**9),
    ("ae", ("encoder", "width"), 512),
    ("ae", ("encoder", "blocks"), 10**9),
    ("ae", ("decoder", "layers"), 10**9),
    ("ae", ("decoder", "layers"), 5_000),
    ("ae", ("decoder", "point_width"), 10**9),
    ("ae", ("points",), 10**9),
    ("ae", ("window",), 10**12),
    ("ae", ("encoder",), None),
    ("ae", ("decoder", "width"), -4),
    ("ae", ("decoder", "width"), "wide"),
    ("lms", ("synthesiser", "width"), 10**9),
    ("lms", ("synthesiser", "key_layers"), 10**9),
    ("lms", ("longest_gap",), 10**12),
]


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    return write_random_weights(tmp_path_factory.mktemp("weights") / "w")


@pytest.mark.parametrize(("part", "keys", "value"), CHANGES)
def test_sizes_beyond_the_weights_are_refused(weights, part, keys, value):
    path = open_artefact(weights / part).folder / "config.json"
    before = path.read_text()
    config = json.loads(before)
    where = config
    for key in keys[:-1]:
        where = where[key]
    where[keys[-1]] = value
    path.write_text(json.dumps(config))
    peak = peak_mb(reset=True)
    try:
        with pytest.raises(InputError, match="is damaged") as caught:
            load_weights(weights)
    finally:
        path.write_text(before)
    assert len(str(caught.value)) < 600 and "\n" not in str(caught.value)
    assert peak_mb() - peak < 200


def test_the_weights_themselves_are_loaded(weights):
    assert load_autoencoder(weights / "ae").points > 0
