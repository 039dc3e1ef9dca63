"""The shipped weights on real, held-out recordings: clouds come back; a rig moves a latent no more than a draw."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from data_schemas.metrics import read_metrics
from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest
from stages.measure.ae.config import Config as AeConfig
from stages.measure.ae.run import run as measure_ae
from stages.measure.ae.summary import REFERENCE
from stages.measure.latents.config import Config as LatentsConfig
from stages.measure.latents.run import run as measure_latents
from stages.sample_tpc.config import Config as SampleConfig
from stages.sample_tpc.run import run as sample

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
WEIGHTS = Path(__file__).resolve().parents[2] / "stages" / "shared" / "weights" / "small-free"
pytestmark = [
    pytest.mark.real,
    pytest.mark.skipif(not (DATA / "bandai-namco-1.zip").exists(), reason="needs ../shared/data"),
]


@pytest.fixture(scope="module")
def motions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four clips of a test split that the weights never saw."""
    folder = tmp_path_factory.mktemp("real_latents")
    held_out = json.loads((DATA / "splits.json").read_text())["bandai-namco-1.zip"]["test"]
    with zipfile.ZipFile(DATA / "bandai-namco-1.zip") as archive:
        sized = sorted(held_out, key=lambda name: archive.getinfo(name).file_size)
        for name in sized[-4:]:
            (folder / Path(name).name).write_bytes(archive.read(name))
    ingest(IngestConfig(sources=(str(folder),), output=folder / "motions"))
    return folder / "motions"


def means(output: Path) -> dict[tuple[str, str], float]:
    rows, _ = read_metrics(output)
    keys = {(row.method, row.metric) for row in rows}
    return {key: float(np.mean([r.value for r in rows if (r.method, r.metric) == key])) for key in keys}


def test_another_rig_moves_latents_no_more_than_another_draw(motions: Path, tmp_path: Path):
    """With points spread evenly all rigs stay well below what drawing points at random moves latents by."""
    every = ("train", "val", "test")
    measure_latents(LatentsConfig(motion=motions, output=tmp_path / "out", splits=every, max_windows=3, window=48))
    found = means(tmp_path / "out")
    redrawn = found["points redrawn", "move_any"]
    for rig in ("twist-joints", "fingers", "other-axes", "extra-spine", "all-of-these"):
        assert found[f"rig: {rig}, spread", "move_any"] < 0.6 * redrawn, rig
    assert found["points spread evenly, anew", "move_any"] < 0.6 * redrawn
    assert redrawn < found["turned by 180 degrees, same draw", "move_any"]


def test_clouds_come_back_about_as_far_as_two_true_draws_are(motions: Path, tmp_path: Path):
    sample(SampleConfig(motion=motions, output=tmp_path / "tpc"))
    every = ("train", "val", "test")
    measure_ae(
        AeConfig(
            tpc=tmp_path / "tpc",
            weights=(f"small-free={WEIGHTS / 'ae'}",),
            output=tmp_path / "out",
            splits=every,
            max_windows=8,
            pictures=0,
        )
    )
    found = means(tmp_path / "out")
    assert found["small-free", "rec_mm"] < 1.2 * found[REFERENCE, "rec_mm"]
    assert found[REFERENCE, "spread"] == pytest.approx(1, abs=0.1)
    assert 0.5 < found["small-free", "spread"] < 1.1
