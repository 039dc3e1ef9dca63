"""`pumps train recogniser` tells motions apart, and reads no padding."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError
from stages.shared.networks.concepts.action_recogniser import ActionRecogniser
from stages.train.recogniser.config import Config
from stages.train.recogniser.run import run
from tests.shared.concepts.two_actions import write_two_actions


@pytest.fixture(scope="module")
def concepts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recogniser") / "c"
    write_two_actions(path)
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
