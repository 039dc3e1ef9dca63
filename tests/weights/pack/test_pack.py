"""Packing a run's networks: half the size, the same answers within half precision, one card."""

import shutil

import numpy as np
import pytest
import torch

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.checkpoint import read_checkpoint, write_checkpoint
from data_schemas.errors import InputError
from data_schemas.metrics import MetricRow, write_metrics
from stages.shared.inference.models import load_weights
from stages.shared.weights.facts import facts_of
from stages.weights.pack.config import Config
from stages.weights.pack.run import run
from tests.shared.inference.examples import write_random_weights


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


def test_weights_do_not_say_where_they_were_trained(trained, tmp_path):
    lms = trained / "train-lms"
    kept, licences = read_checkpoint(open_artefact(lms)), open_artefact(lms).manifest.licences
    settings = {"initial": "/home/ann/old/train-lms", "sizes": {"kept": ["C:\\runs\\ae", "runs/tpc", 3]}}
    shutil.rmtree(lms)
    with write_artefact(lms, "checkpoint", stage="train-lms", config=settings, licences=licences) as draft:
        card = kept.card + "\nStarted from: the weights in /home/ann/old/train-lms.\n"
        write_checkpoint(
            draft.folder, weights=kept.weights, config=kept.config, optimiser=None, log=kept.log, card=card
        )
    run(Config(run=trained, output=tmp_path / "packed"))
    packed = open_artefact(tmp_path / "packed" / "lms")
    assert packed.manifest.config["trained"] == {"initial": "train-lms", "sizes": {"kept": ["ae", "runs/tpc", 3]}}
    assert "Started from: the weights in train-lms." in read_checkpoint(packed).card
    for path in (tmp_path / "packed").rglob("*"):
        assert path.is_dir() or b"/home/ann" not in path.read_bytes()


def test_networks_of_two_runs_are_not_packed_together(trained, tmp_path):
    other = write_random_weights(tmp_path / "other", seed=1)
    (trained / "train-ae").rename(tmp_path / "away")
    (other / "ae").rename(trained / "train-ae")
    with pytest.raises(InputError, match="another autoencoder"):
        run(Config(run=trained, output=tmp_path / "packed"))


def _measured(path, inputs, method="pumps"):
    rows = [
        MetricRow(f"clip{clip}", "s", "a", name, "interpolation", 15, "l2p_m", value + 0.01 * clip)
        for clip in range(4)
        for name, value in (("slerp", 1.0), ("damped", 0.9), (method, 0.5))
    ]
    feel = [("truth", 0.01), ("lerp", 0.4), ("slerp", 0.3), (method, 0.02), ("another", 0.1)]
    rows += [MetricRow("clip0", "s", "a", name, "interpolation", 15, "foot_skate_mps", value) for name, value in feel]
    with write_artefact(path, "metrics", stage="evaluate", config={}, inputs=inputs) as draft:
        write_metrics(draft.folder, rows, "# Evaluation\n")
    return path


def test_what_was_measured_goes_with_the_weights(trained, tmp_path):
    inputs = [open_artefact(trained / name) for name in ("train-ae", "train-lms")]
    metrics = _measured(tmp_path / "metrics", inputs)
    run(Config(run=trained, output=tmp_path / "packed", measured=metrics))
    (row,) = [row for row in facts_of(tmp_path / "packed")["measured"] if row["scope"] == "all archives"]
    assert row["task"] == "interpolation" and row["high"] < 0.6 < row["ratio"] + 0.15
    card = (tmp_path / "packed" / "MODEL_CARD.md").read_text()
    assert "Good at: interpolation 15" in card and "| damped |" in card
    assert sum(line.startswith("|  | pumps |  |  | 0.0200") for line in card.splitlines()) == 1
    assert "### Feel\n" in card and "plain interpolation. Of a." in card
    assert "| interpolation 15 | truth |  |  | 0.0100" in card
    assert "another" not in card and "lerp |  |  | 0.4" not in card.replace("slerp", "")


def test_what_was_measured_of_other_weights_is_refused(trained, tmp_path):
    inputs = [open_artefact(trained / "train-ae")]
    with pytest.raises(InputError, match="measured other weights"):
        run(Config(run=trained, output=tmp_path / "p", measured=_measured(tmp_path / "m", inputs)))
    inputs.append(open_artefact(trained / "train-lms"))
    metrics = _measured(tmp_path / "m", inputs, method="else")
    with pytest.raises(InputError, match="no method 'pumps'"):
        run(Config(run=trained, output=tmp_path / "p", measured=metrics))
