"""`pumps weights adapt`: any recordings in, a folder of weights out that other commands take."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pumps
from data_schemas.artefact import open_artefact
from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError, UsageError
from stages.shared.inference.models import load_weights
from stages.shared.progress import SILENT
from stages.shared.statistics.windows import tasks_of
from stages.shared.weights.facts import facts_of
from stages.weights.adapt import measuring
from stages.weights.adapt import run as adapt
from stages.weights.adapt.choosing import Candidate, Choice
from stages.weights.adapt.clips import read_clips
from stages.weights.adapt.config import Config
from stages.weights.adapt.holding_out import Part
from stages.weights.adapt.training import write_clouds
from tests.shared.formats.bvh_texts import BvhText
from tests.shared.inference.examples import write_random_weights


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_random_weights(tmp_path_factory.mktemp("weights"))


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings")
    for seed in range(3):
        (folder / f"walk_{seed}.bvh").write_bytes(BvhText(frames=100, seed=seed).data())
    (folder / "torn.bvh").write_bytes(b"HIERARCHY\nROOT")
    return folder


@pytest.fixture(autouse=True)
def _few_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stages.weights.adapt.training._HELD_BACK", (2,))
    monkeypatch.setattr("stages.weights.adapt.measuring._POINTS", 32)
    few = tuple(tasks_of((15,), (15,), (), 60))
    for module in (adapt, measuring):
        monkeypatch.setattr(module, "TASKS", few)


def _config(recordings: Path, weights: Path, output: Path, **settings: Any) -> Config:
    small = {"steps": 2, "batch": 2, "validate_every": 1, "max_windows": 2, "device": "cpu"}
    return Config(**{"clips": (str(recordings),), "weights": str(weights), "output": output, **small, **settings})


def _choosing(monkeypatch: pytest.MonkeyPatch, name: str, *, fitted: bool = False) -> None:
    kept = Candidate(name, fitted)
    monkeypatch.setattr(adapt, "choose", lambda measured, start, errors: Choice(kept, 0.1, 0.05, 1.0))


def test_trained_weights_are_written_with_what_they_are(recordings, weights, tmp_path, monkeypatch):
    _choosing(monkeypatch, adapt.TRAINED, fitted=True)
    report = adapt.run(_config(recordings, weights, tmp_path / "mine"))
    models = load_weights(tmp_path / "mine", "cpu")
    assert models.confidence is not None and "the recordings' own" in models.licences
    kept = read_checkpoint(tmp_path / "mine" / "lms", optimiser=False)
    start = read_checkpoint(weights / "lms", optimiser=False)
    assert any((kept.weights[name] != start.weights[name].astype(np.float16)).any() for name in start.weights)
    assert len(kept.trainings) == len(start.trainings) + 1 and kept.trainings[-1].steps == 2
    facts = kept.config["adapted_from"]
    assert facts["digests"]["lms"] == open_artefact(weights / "lms").manifest.digest
    assert facts["kept"] == "trained" and facts["confidence_fitted"] is True
    measured = [(each["weights"], each["confidence_fitted"]) for each in facts["held_out"]["scores"]]
    assert sorted(measured) == [(name, fitted) for name in ("mean", "start", "trained") for fitted in (False, True)]
    assert facts_of(tmp_path / "mine")["validation"]["synthesiser"]["step"] in (1, 2)
    assert "Kept: trained with the confidence fitted anew" in (tmp_path / "mine" / "MODEL_CARD.md").read_text()
    assert any("torn.bvh" in line for line in report.lines)
    assert not (tmp_path / "mine.partial").exists()


def test_weights_that_gain_nothing_are_not_kept_and_that_is_said(recordings, weights, tmp_path, monkeypatch):
    _choosing(monkeypatch, adapt.START)
    report = adapt.run(_config(recordings, weights, tmp_path / "mine"))
    assert any("no candidate was better" in line for line in report.lines)
    assert report.figures["before"] == report.figures["after"]
    kept = read_checkpoint(tmp_path / "mine" / "lms", optimiser=False)
    start = read_checkpoint(weights / "lms", optimiser=False)
    assert all((kept.weights[name] == start.weights[name].astype(np.float16)).all() for name in start.weights)
    models = load_weights(tmp_path / "mine", "cpu")
    assert models.confidence is None and models.licences == ("test only",)


def test_an_interrupted_adaptation_goes_on(recordings, weights, tmp_path, monkeypatch):
    class Said:
        def __init__(self) -> None:
            self.messages: list[str] = []

        def start(self, label: str, total: float | None = None) -> None: ...

        def advance(self, steps: float = 1, note: str = "") -> None: ...

        def message(self, text: str) -> None:
            self.messages.append(text)

    def killed(*_: Any) -> None:
        raise KeyboardInterrupt

    config = _config(recordings, weights, tmp_path / "mine")
    with monkeypatch.context() as patched:
        patched.setattr(adapt, "measure", killed)
        with pytest.raises(KeyboardInterrupt):
            adapt.run(config)
    assert not (tmp_path / "mine").exists()
    said = Said()
    adapt.run(config, progress=said)
    assert any("going on from step 2" in text for text in said.messages)
    load_weights(tmp_path / "mine", "cpu")


def test_what_is_there_is_replaced_on_request_and_only_weights(recordings, weights, tmp_path, monkeypatch):
    _choosing(monkeypatch, adapt.START)
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "diary.txt").write_text("mine")
    with pytest.raises(UsageError, match="Give --overwrite"):
        adapt.run(_config(recordings, weights, mine))
    with pytest.raises(UsageError, match=r"diary\.txt, which is no part of weights"):
        adapt.run(_config(recordings, weights, mine, overwrite=True))
    (mine / "diary.txt").unlink()
    write_random_weights(mine)
    adapt.run(_config(recordings, weights, mine, overwrite=True))
    assert load_weights(mine, "cpu").trained_on == load_weights(weights, "cpu").trained_on
    assert "adapted_from" in read_checkpoint(mine / "lms", optimiser=False).config


@pytest.mark.parametrize(
    ("frames", "sentence"),
    [(60, r"has 2\.0 seconds, and 6\.7 are needed"), (1, "None of the recordings")],
)
def test_recordings_that_cannot_be_used_are_one_sentence(frames: int, sentence: str, weights, tmp_path):
    (tmp_path / "short.bvh").write_bytes(BvhText(frames=frames).data())
    with pytest.raises(InputError, match=sentence):
        adapt.run(_config(tmp_path / "short.bvh", weights, tmp_path / "mine"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["short.bvh"]


def test_motions_in_python_are_recordings_too(recordings, weights, tmp_path, monkeypatch):
    _choosing(monkeypatch, adapt.MEAN)
    motions = [pumps.load(recordings / f"walk_{seed}.bvh") for seed in range(3)]
    found = pumps.adapt(
        motions, tmp_path / "mine", weights=weights, steps=1, device="cpu", licence="walks, mine alone"
    )
    assert found["kept"] == adapt.MEAN and found["confidence_fitted"] is False and found["steps"] == 1
    assert "walks, mine alone" in open_artefact(tmp_path / "mine" / "lms").manifest.licences
    assert facts_of(tmp_path / "mine")["validation"]["synthesiser"] == {}  # nobody validated the mean
    filled = pumps.infill(motions[0], keyframes="every:30", weights=tmp_path / "mine")
    assert filled.frames == 100
    with pytest.raises(UsageError, match="mixes motions with names"):
        pumps.adapt([motions[0], "walk.bvh"], tmp_path / "other")
    with pytest.raises(InputError, match="The longest recording has"):
        pumps.adapt(motions[0], tmp_path / "other")


def test_recordings_of_one_name_are_told_apart(recordings, weights, tmp_path):
    motion = pumps.load(recordings / "walk_0.bvh")
    for folder in ("one", "two"):
        pumps.write_clips([motion], tmp_path / folder)
    config = _config(recordings, weights, tmp_path / "mine", clips=(str(tmp_path / "one"), str(tmp_path / "two")))
    clips = read_clips(config, SILENT).clips
    rows = write_clouds(tmp_path / "tpc", clips, [Part(0, 0, 100), Part(1, 0, 100, held_out=True)], 32, 0)
    assert len({row.clip for row in rows}) == 2
    assert {row.licence for row in rows} == {"the recordings' own"}
