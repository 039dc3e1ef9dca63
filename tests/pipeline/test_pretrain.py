"""`make pretrain` from recordings to packed weights: in slices, killed in between, on a copy without recordings."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from data_schemas.artefact import verify
from data_schemas.tpc import TpcReader
from stages.shared.weights.facts import facts_of
from tests.docs.pages import ROOT
from tests.pipeline.tiny_pipeline import CLIPS, SETTINGS

STEPS = {
    "train-ae.steps": 30, "train-lms.steps": 12, "train-ae.validate_every": 15, "train-lms.validate_every": 6,
    "evaluate.transitions": [], "evaluate.predictions": [], "train-ae.encoder.blocks": 2,
    "sample-tpc.mixed_rigs": 1.0,
}  # fmt: skip
SMALL = {
    **SETTINGS, **STEPS, "train-lms.synthesiser.key_layers": 1, "train-lms.synthesiser.fill_layers": 1,
    "train-lms.synthesiser.frame_layers": 1, "train-ae.decoder.codes": 8, "train-ae.decoder.point_width": 8,
}  # fmt: skip


@pytest.fixture
def make(fast_python: tuple[str, ...]) -> Callable[..., subprocess.Popen[str]]:
    """Starts make for a goal, in a process group of its own."""
    return partial(_make, fast_python)


def _make(python: tuple[str, ...], place: Path, goal: str, **options: object) -> subprocess.Popen[str]:
    settings = " ".join(f"{name}={json.dumps(value, separators=(',', ':'))}" for name, value in SMALL.items())
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("MAKE", "MFLAGS"))}
    words = [f"{name}={value}" for name, value in options.items()]
    command = [
        "make", goal, f"PUMPS={' '.join(python)} -m pumps_cli", f"RUNS={place / 'runs'}", f"DATA={place / 'data'}",
        "FPS_OVERRIDE=", f"SET={settings}", "RECIPE=small", *words,
    ]  # fmt: skip
    environment = {**kept, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        command, cwd=ROOT, env=environment, text=True, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip


def _said(process: subprocess.Popen[str]) -> str:
    return process.communicate(timeout=400)[0]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("pretrain")
    (place / "data").mkdir()
    for name in ("walk.bvh", "run.bvh", "kick.bvh"):
        shutil.copy(CLIPS / name, place / "data" / name)
    splits = {"data": {"val": ["run.bvh"], "test": ["kick.bvh"]}}
    (place / "data" / "splits.json").write_text(json.dumps(splits))
    return place


def test_slices_and_a_kill_end_in_packed_weights(place: Path, make: Callable[..., subprocess.Popen[str]]) -> None:
    run = place / "runs" / "small"
    killed = make(place, "pretrain")
    checkpoints = run / "train-ae.partial" / "checkpoints"
    deadline = time.monotonic() + 200
    while killed.poll() is None and not (checkpoints.is_dir() and any(checkpoints.glob("*/manifest.json"))):
        assert time.monotonic() < deadline, "the training never wrote a checkpoint"
        time.sleep(0.02)
    os.killpg(killed.pid, signal.SIGKILL)
    killed.communicate()
    with TpcReader(run / "sample-tpc") as reader:
        assert reader.artefact.manifest.config["pack"] is True
    before = (run / "sample-tpc" / "manifest.json").stat().st_mtime_ns

    first = make(place, "pretrain", SLICE="0.002")
    said = _said(first)
    assert first.returncode != 0 and "run make again to go on" in said, said
    # On another machine: what was packed of the data, the settings, and the training so far.
    away = place / "away"
    shutil.copytree(run, away / "runs" / "small", ignore=shutil.ignore_patterns("ingest"))
    there = make(away, "pretrain", SLICE="9")
    said = _said(there)
    assert there.returncode == 0, said
    assert "going on from step" in said
    packed = away / "runs" / "small" / "packed" / "small"
    assert not verify(packed / "ae") and not verify(packed / "lms")
    facts = facts_of(packed)
    assert facts["steps"] == {"autoencoder": 30, "synthesiser": 12} and facts["measured"] == []

    # Further steps from there, twice, each time from the mean of the last end and beginning.
    for name in ("config", "sample-tpc"):
        shutil.copytree(run / name, away / "runs" / "longer" / name)
    more = make(away, "pretrain", RUN="longer", INITIAL=packed, AE=packed / "ae", ROUNDS=2)
    said = _said(more)
    assert more.returncode == 0 and "mean of 2 checkpoints" in said, said
    assert facts_of(away / "runs" / "longer" / "packed" / "small")["steps"] == {"autoencoder": 30, "synthesiser": 36}

    bundled = make(away, "pretrain-bundle", TO=place / "bundle")
    assert bundled.wait(100) == 0 and (place / "bundle" / "small.tar.aa").stat().st_size < 15 * 2**20
    # Home again: what came back is measured on the test clips.
    shutil.copytree(away / "runs" / "small" / "packed", run / "packed")
    home = make(place, "pretrain-measure")
    said = _said(home)
    assert home.returncode == 0, said
    measured = run / "measured" / "small"
    assert facts_of(measured)["measured"] and "slerp" in (measured / "MODEL_CARD.md").read_text()
    assert (run / "sample-tpc" / "manifest.json").stat().st_mtime_ns == before
