"""`pumps measure constraints` on the clips that come with pumps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_schemas.errors import InputError
from data_schemas.metrics import read_metrics
from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest
from stages.measure.constraints.cases import asked_of, compared_joints
from stages.measure.constraints.config import CONSTRAINTS, Config
from stages.measure.constraints.run import run, without_answers
from stages.measure.constraints.summary import CONSTRAINED, FREE, PLAIN
from stages.shared.inference.constraints.known_parts import known_parts
from tests.shared.inference.examples import humanoid, swinging, write_random_weights

CLIPS = Path(__file__).resolve().parents[3] / "stages" / "shared" / "clips"


@pytest.fixture(scope="module")
def motion(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("motion") / "motion"
    ingest(IngestConfig(sources=(str(CLIPS / "kick.bvh"),), output=folder, licence="CC0", workers=1))
    return folder


def test_every_constraint_is_measured(motion, tmp_path):
    weights = write_random_weights(tmp_path / "weights")
    settings = {"motion": motion, "weights": str(weights), "splits": ("train", "val", "test"), "max_windows": 1}
    report = run(Config(output=tmp_path / "out", window=46, interval=15, device="cpu", **settings))
    rows, page = read_metrics(tmp_path / "out")
    for constraint in CONSTRAINTS:
        own = [row for row in rows if row.task == constraint]
        assert constraint == "hands" or {row.method for row in own} == {PLAIN, FREE, CONSTRAINED}
        assert all(np.isfinite(row.value) for row in own)
    off = [row.value for row in rows if row.metric == "pin_off_mm"]
    assert all(value < 10 for value in off) and (off or report.figures["out_of_reach"])
    assert "pumps measure constraints" in page and len(report.lines) == len(CONSTRAINTS) + 1
    with pytest.raises(InputError, match="no clip"):
        run(Config(output=tmp_path / "none", window=900, **settings))


def test_nothing_of_the_answer_is_seen():
    skeleton = humanoid()
    truth = swinging(skeleton, 31)
    parts = known_parts(asked_of("path", skeleton, truth, 15), skeleton, 31)
    seen = without_answers(skeleton, truth, parts)
    missing = ~parts.whole
    assert (seen.rotations[missing] == [0, 0, 0, 1]).all() and not seen.root_positions[missing].any()
    assert np.array_equal(seen.rotations[~missing], truth.rotations[~missing])


def test_compared_joints():
    skeleton = humanoid()
    named = {c: {skeleton.names[j] for j in compared_joints(c, skeleton)} for c in CONSTRAINTS}
    assert named["arms"] == named["hands"] and "left_arm" in named["arms"] and "head" not in named["arms"]
    assert "left_shin" in named["legs"] and named["legs"] | named["arms"] < named["path"]
