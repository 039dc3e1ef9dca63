"""Motion concepts as methods of `pumps evaluate`: transitions between keys, and fills that they refine."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_schemas.artefact import write_artefact
from data_schemas.errors import InputError
from data_schemas.fills import FillsReader
from data_schemas.metrics import read_metrics
from data_schemas.motion import ClipRow, MotionWriter
from stages.evaluate.config import Config
from stages.evaluate.run import run
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.statistics.measurements import TRUTH

pytest.importorskip("sklearn")
from tests.shared.concepts.two_actions import CLIPS, train_two_actions


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return train_two_actions(tmp_path_factory.mktemp("concepts"))


def write_walk(path: Path, source: str) -> Path:
    skeleton, motion, _ = motion_of(read_bvh((CLIPS / "walk.bvh").read_bytes(), "walk"))
    with write_artefact(path, "motion", stage="t", config={}) as draft, MotionWriter(draft.folder) as writer:
        row = ClipRow(
            clip="walk", source=source, sha256="0" * 64, skeleton=writer.add_skeleton(skeleton), frames=motion.frames,
            fps=motion.fps, seconds=motion.frames / motion.fps, split="test", licence="CC0",
        )  # fmt: skip
        writer.add_clip(row, motion)
        draft.licences.add("CC0")
    return path


def settings(weights: Path) -> dict:
    return {
        "weights": ("small-free", f"concepts={weights}"), "refine": weights, "tasks": ("interpolation",),
        "intervals": (15,), "window": 46, "max_windows": 1, "device": "cpu", "plain": False, "keep_fills": True,
        "points": 64,
    }  # fmt: skip


def test_both_are_measured_and_keep_the_keys(weights: Path, tmp_path: Path):
    motion = write_walk(tmp_path / "m", "set.zip!dataset-1_walk_a_001.bvh")
    run(Config(motion=motion, output=tmp_path / "e", **settings(weights)))
    rows, _ = read_metrics(tmp_path / "e")
    assert {row.method for row in rows} == {TRUTH, "small-free", "concepts", "small-free-refined"}
    assert all(np.isfinite(row.value) for row in rows)
    with FillsReader(tmp_path / "e") as fills:
        (batch,) = fills.batches
        made = {
            method: fills.poses(batch, method) for method in (TRUTH, "small-free", "concepts", "small-free-refined")
        }
    keys = np.arange(0, 46, 15)
    for name in ("concepts", "small-free-refined"):
        for found, true in zip(made[name], made[TRUTH], strict=True):
            np.testing.assert_allclose(found[:, keys], true[:, keys], atol=2e-4)  # kept in 16 bits
    assert np.abs(made["small-free"][1] - made["small-free-refined"][1]).max() > 1e-3


def test_clips_of_an_action_that_was_not_learned_are_named(weights: Path, tmp_path: Path):
    motion = write_walk(tmp_path / "m", "set.zip!dataset-1_swim_a_001.bvh")
    with pytest.raises(InputError, match=r"action of 1 of 1 clips, walk \(swim\)"):
        run(Config(motion=motion, output=tmp_path / "e", **settings(weights)))
    assert not (tmp_path / "e").exists()
