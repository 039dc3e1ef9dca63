"""Lost limbs: what is hidden is not read, what is seen stays, figures of each method, bad input."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from data_schemas.metrics import MetricRow, read_metrics
from data_schemas.motion import MotionReader
from stages.measure.body_parts.config import Config
from stages.measure.body_parts.lost import (
    FILLED,
    FOR_GOOD,
    HELD,
    HIDDEN,
    INTERPOLATED,
    LOST_METRICS,
    RECONSTRUCTED,
    SEEN_AGAIN,
    TRUTH,
    Stretch,
    limbs_of,
    rows_of_lost,
    stretches_of,
    without_limbs,
)
from stages.measure.body_parts.run import run
from stages.shared.inference.models import Models, load_weights
from stages.shared.inference.part_models import PartBody, load_part_bodies
from stages.shared.kinematics.forward_numpy import local_rotations
from stages.shared.progress import SILENT
from stages.train.body_parts.run import run as train
from tests.train.body_parts.small_parts import ingested, settings


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lost")
    motion = ingested(folder)
    for parts in (1, 5):
        train(settings(motion, folder / f"{parts}", parts=parts))
    return folder


@pytest.fixture(scope="module")
def bodies(trained: Path) -> dict[str, PartBody]:
    return load_part_bodies([f"BPs{parts}={trained / str(parts)}" for parts in (1, 5)], "cpu")


@pytest.fixture(scope="module")
def models() -> Models:
    return load_weights("small-free", "cpu")


def _config(trained: Path, output: Path, **changed) -> Config:
    values = {
        "motion": f"clips={trained / 'ingest'}",
        "weights": [f"BPs{parts}={trained / str(parts)}" for parts in (1, 5)],
        "output": output,
        "seeds": 1,
        "max_windows": 4,
        "pumps": "small-free",
        "lost_seconds": 0.5,
        "lost_stretches": 1,
        "device": "cpu",
    }
    return Config.model_validate({**values, **changed})


@pytest.fixture(scope="module")
def stretch(trained: Path, bodies: dict[str, PartBody]) -> Stretch:
    with MotionReader(trained / "ingest") as reader:
        rows = [row for row in reader.clips if row.split == "test"]
        (found,) = stretches_of(reader, rows, bodies["BPs5"], _config(trained, trained / "unused"))
    return found


def _values(rows: list[MetricRow], task: str, metric: str) -> dict[str, float]:
    return {row.method: row.value for row in rows if row.task == task and row.metric == metric}


def test_every_method_is_measured_and_shown(trained: Path, tmp_path: Path):
    run(_config(trained, tmp_path / "out"))
    rows, page = read_metrics(tmp_path / "out")
    parts = {f"{name}, {what}" for name in ("BPs1", "BPs5") for what in (HIDDEN, HELD, RECONSTRUCTED)}
    for task in (SEEN_AGAIN, FOR_GOOD):
        for metric in LOST_METRICS:
            assert set(_values(rows, task, metric)) == {TRUTH, INTERPOLATED, FILLED, *parts}
        assert f"### clips: {task}" in page and "1 stretches of 1 clips, 16 lost frames each" in page
        found = _values(rows, task, LOST_METRICS[0])
        assert found.pop(TRUTH) == 0 and min(found.values()) > 0


def test_what_is_lost_is_not_read(trained: Path, bodies: dict[str, PartBody], models: Models, stretch: Stretch):
    """The legs' rotations in the lost frames change the result of no method but the one that sees them."""
    config = _config(trained, trained / "unused")
    legs = limbs_of(stretch.skeleton, (3, 4))
    hidden = without_limbs(stretch.skeleton, stretch.motion, legs, stretch.lost)
    local = stretch.local.copy()
    own = np.isin(bodies["BPs5"].body.groups, (3, 4))
    local[np.ix_(stretch.lost, own)] = [0, 0, 0, 1]
    changed = replace(stretch, motion=hidden, local=local)
    found = [list(rows_of_lost(config, "clips", bodies, models, [each], SILENT)) for each in (stretch, changed)]
    # Steps at the first seam have the truth on one side and the method's result on the other.
    first, second = (_values(rows, FOR_GOOD, "seam_cm") for rows in found)
    for method in (INTERPOLATED, FILLED, f"BPs5, {HIDDEN}", f"BPs1, {HIDDEN}", f"BPs5, {HELD}"):
        assert first[method] == pytest.approx(second[method], abs=1e-5), method
    for method in (TRUTH, f"BPs5, {RECONSTRUCTED}"):
        assert abs(first[method] - second[method]) > 1e-3


def test_limbs_hang_down_and_the_rest_stays(stretch: Stretch):
    skeleton, motion = stretch.skeleton, stretch.motion
    limbs = limbs_of(skeleton, (3, 4))
    made = without_limbs(skeleton, motion, limbs, stretch.lost)
    before, after = (local_rotations(each.rotations, skeleton.parents) for each in (motion, made))
    away = 1 - np.abs((before * after).sum(-1))
    assert away[:, ~limbs].max() < 1e-6 and away[~stretch.lost].max() < 1e-6
    assert np.abs(after[np.ix_(stretch.lost, limbs)] - [0, 0, 0, 1]).max() < 1e-6
    assert stretch.lost.sum() == 16 and not stretch.lost[:16].any() and not stretch.lost[-16:].any()


def test_unknown_limbs_and_clips_that_are_too_short(trained: Path, tmp_path: Path, bodies: dict[str, PartBody]):
    with pytest.raises(ValidationError, match="left_arm, right_arm, left_leg, right_leg"):
        _config(trained, tmp_path / "out", lost=["spine"])
    report = run(_config(trained, tmp_path / "out", lost_seconds=60))
    assert any("No clip is long enough" in line for line in report.lines)
    assert "Lost limbs" not in read_metrics(tmp_path / "out")[1]
