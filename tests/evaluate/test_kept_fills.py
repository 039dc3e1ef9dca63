"""Windows that `evaluate` keeps: they give the figures of its rows again, and their size is bounded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_schemas.artefact import write_artefact
from data_schemas.clips import ClipRow
from data_schemas.errors import InputError
from data_schemas.fills import FILLS_NAME, FillsReader, kept_joints
from data_schemas.manifest import open_artefact
from data_schemas.metrics import read_metrics
from data_schemas.motion import MotionWriter
from stages.evaluate import kept_fills
from stages.evaluate.config import Config
from stages.evaluate.run import run
from stages.shared.statistics.measurements import TRUTH, measured_joints
from stages.shared.statistics.metrics import l2p_m, mpjae_deg
from tests.evaluate.swaying import skeleton, swaying

TASKS = {"tasks": ("interpolation", "transition"), "intervals": (15,), "transitions": (15,), "window": 61}


@pytest.fixture(scope="module")
def motions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kept") / "motions"
    with (
        write_artefact(folder, "motion", stage="ingest", config={}, licences=["CC0"]) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        for number, size in enumerate([1.0, 0.7]):
            rig = writer.add_skeleton(skeleton(size))
            row = ClipRow(f"c{number}", f"set.zip!c{number}.bvh", "0" * 64, rig, 130, 30.0, 130 / 30, "test", "CC0")
            writer.add_clip(row, swaying(number, 130))
    return folder


def test_kept_windows_give_the_rows_again(motions: Path, tmp_path: Path):
    run(Config(motion=motions, output=tmp_path / "kept", keep_fills=True, **TASKS))
    run(Config(motion=motions, output=tmp_path / "bare", **TASKS))
    rows, _ = read_metrics(tmp_path / "kept")
    assert rows == read_metrics(tmp_path / "bare")[0]
    assert not (open_artefact(tmp_path / "bare").folder / FILLS_NAME).exists()
    assert open_artefact(tmp_path / "kept").manifest.licences == ["CC0"]
    expected = {(r.clip, r.task, r.method, r.metric): r.value for r in rows}
    seen = 0
    with FillsReader(tmp_path / "kept") as reader:
        for batch in reader.batches:
            assert batch.methods == (TRUTH, "lerp", "slerp", "cubic", "damped")
            rig = reader.skeleton(batch.skeleton)
            measured = np.searchsorted(kept_joints(rig), measured_joints(rig))
            true = [part[:, :, measured] for part in reader.poses(batch, TRUTH)]
            assert len(set(batch.clips)) == 1  # one clip of each skeleton
            for method in batch.methods[1:]:
                positions, rotations = (part[:, :, measured] for part in reader.poses(batch, method))
                row = batch.clips[0], batch.task, method
                assert l2p_m(positions, true[0]).mean() == pytest.approx(expected[(*row, "l2p_m")], abs=2e-4)
                assert mpjae_deg(rotations, true[1]).mean() == pytest.approx(expected[(*row, "mpjae_deg")], abs=0.02)
                np.testing.assert_allclose(positions[:, batch.known], true[0][:, batch.known], atol=2e-4)
                seen += 1
    assert seen == 2 * 2 * 4


def test_more_than_the_bound_is_refused_before_anything_is_filled(motions: Path, tmp_path: Path, monkeypatch):
    monkeypatch.setattr(kept_fills, "MOST_BYTES", 1000)
    with pytest.raises(InputError, match=r"would take 0\.0 GB, and at most") as caught:
        run(Config(motion=motions, output=tmp_path / "kept", keep_fills=True, **TASKS))
    assert "--max-windows" in str(caught.value.hint) and not (tmp_path / "kept").exists()
