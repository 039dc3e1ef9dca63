"""Packing a run's networks: half the size, the same answers within half precision, one card."""

import numpy as np
import pytest
import torch

from data_schemas.errors import InputError
from stages.inference.models import load_weights
from stages.pack_weights.config import Config
from stages.pack_weights.run import run
from tests.inference.examples import write_random_weights


@pytest.fixture
def trained(tmp_path):
    folder = write_random_weights(tmp_path / "run")
    for old, new in (("ae", "train-ae"), ("lms", "train-lms")):
        (folder / old).rename(folder / new)
    return folder


def test_packed_weights_load_and_answer_alike(trained, tmp_path):
    report = run(Config(run=trained, output=tmp_path / "packed"))
    assert report.figures["bytes"] > 0
    before, after = load_weights(trained, "cpu"), load_weights(tmp_path / "packed", "cpu")
    generator = torch.Generator().manual_seed(0)
    points, groups = torch.randn(4, 32, 3, generator=generator), torch.randint(0, 5, (32,), generator=generator)
    one, two = before.encode(points, groups)[0], after.encode(points, groups)[0]
    np.testing.assert_allclose(two.numpy(), one.numpy(), atol=0.05)
    size = {
        folder: sum(f.stat().st_size for f in folder.rglob("*.safetensors"))
        for folder in (trained, tmp_path / "packed")
    }
    assert size[tmp_path / "packed"] < 0.6 * size[trained]
    assert "# The weights `packed`" in (tmp_path / "packed" / "MODEL_CARD.md").read_text()


def test_networks_of_two_runs_are_not_packed_together(trained, tmp_path):
    other = write_random_weights(tmp_path / "other", seed=1)
    (trained / "train-ae").rename(tmp_path / "away")
    (other / "ae").rename(trained / "train-ae")
    with pytest.raises(InputError, match="another autoencoder"):
        run(Config(run=trained, output=tmp_path / "packed"))
