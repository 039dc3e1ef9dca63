"""`pumps measure anchors`: figures are of the frames that were segmented, and the ratio is to evenly spaced keys."""

from __future__ import annotations

from pathlib import Path

import pytest

from data_schemas.metrics import read_metrics
from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest
from stages.measure.anchors.config import Config
from stages.measure.anchors.run import run


@pytest.fixture(scope="module")
def motions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("anchors")
    ingest(IngestConfig(sources=("stages/shared/clips/dance_a.bvh",), output=folder / "m"))
    return folder / "m"


def test_keys_a_second_are_of_the_part_of_a_clip_that_is_segmented(motions: Path, tmp_path: Path):
    common = {"motion": motions, "lambdas": (50.0,), "degree": 1, "splits": ("train", "val", "test"), "device": "cpu"}
    rates = []
    for seconds in (2.0, 4.0):
        run(Config(output=tmp_path / f"{seconds}", longest_s=seconds, **common))  # pyright: ignore[reportArgumentType]
        rows, _ = read_metrics(tmp_path / f"{seconds}")
        rates.append(next(row.value for row in rows if row.metric == "keys_per_s"))
    assert rates[0] > 1 and rates[0] == pytest.approx(rates[1], rel=0.5)
