"""`pumps train recogniser` tells motions apart, and reads no padding."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from data_schemas.artefact import write_artefact
from data_schemas.checkpoint import read_checkpoint
from data_schemas.concepts import ClipRow, ConceptsWriter, StoredBody
from data_schemas.errors import InputError
from stages.shared.concepts.body_positions import body_of, body_positions
from stages.shared.concepts.segmenting import segmented
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.kinematics.resampling import resample
from stages.shared.networks.concepts.action_recogniser import ActionRecogniser
from stages.train.recogniser.config import Config
from stages.train.recogniser.run import run

CLIPS = Path(__file__).resolve().parents[3] / "stages" / "shared" / "clips"


@pytest.fixture(scope="module")
def concepts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Halves of two clips as clips of two actions."""
    path = tmp_path_factory.mktemp("recogniser") / "c"
    with write_artefact(path, "concepts", stage="t", config={}) as draft, ConceptsWriter(draft.folder, 200) as writer:
        for name in ("walk", "getup_faceup"):
            skeleton, motion, _ = motion_of(read_bvh((CLIPS / f"{name}.bvh").read_bytes(), name))
            motion, body = resample(motion, 20), body_of(skeleton)
            stored = StoredBody(body.names, body.parents, body.groups)
            writer.add_body(stored)
            places = body_positions(skeleton, motion, body)
            for split, part in (("train", places[::2]), ("test", places[1::2])):
                row = ClipRow(
                    f"{name}.{split}", name, "0" * 64, stored.id, len(part), 20.0, len(part) / 20, split, "CC0"
                )
                writer.add(row, segmented(part, body.scale, 20.0, 200, 4.0, name))
            writer.add_centres(name, np.zeros((1, len(body.names), 3)))
    return path


def test_two_actions_are_told_apart(concepts: Path, tmp_path: Path):
    report = run(
        Config(
            concepts=concepts,
            output=tmp_path / "w",
            steps=40,
            batch=8,
            window=24,
            width=24,
            warmup=2,
            average=0.5,
            validate_every=20,
            checkpoint_every=20,
            device="cpu",
        )
    )
    assert report.figures["test_accuracy"] == 1.0
    assert read_checkpoint(tmp_path / "w").config["test_accuracy"] == 1.0


def test_one_action_cannot_be_told_apart(concepts: Path, tmp_path: Path):
    with pytest.raises(InputError, match="two actions"):
        run(Config(concepts=concepts, output=tmp_path / "w", actions=("walk",), device="cpu"))
    assert not (tmp_path / "w").exists()


def test_padding_is_not_read():
    torch.manual_seed(0)
    network = ActionRecogniser(6, 3, width=8)
    motion, counts = torch.randn(2, 9, 6), torch.tensor([5, 9])
    changed = motion.clone()
    changed[0, 5:] = 100
    for one, two in zip(network(motion, counts), network(changed, counts), strict=True):
        torch.testing.assert_close(one, two)
