"""The published rows of the LaFAN1 benchmark, wherever its BVH files lie: LAFAN1_DIR names their folder."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from data_schemas.metrics import read_metrics
from stages.evaluate.config import Config as EvaluateConfig
from stages.evaluate.run import run as evaluate
from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest

GAPS = (5, 15, 30, 45)
PUBLISHED = {  # of the benchmark's own evaluation, for gaps of 5, 15, 30 and 45 frames
    "zero-velocity": {
        "l2p_lafan1": (1.523, 3.694, 6.600, 9.329),
        "l2q_lafan1": (0.56, 1.10, 1.51, 1.81),
        "npss_lafan1": (0.0053, 0.0522, 0.2318, 0.4918),
    },
    "slerp": {
        "l2p_lafan1": (0.373, 1.249, 2.316, 3.447),
        "l2q_lafan1": (0.22, 0.62, 0.98, 1.25),
        "npss_lafan1": (0.0023, 0.0391, 0.2013, 0.4493),
    },
}
HALF_A_DIGIT = {"l2p_lafan1": 5e-4, "l2q_lafan1": 5e-3, "npss_lafan1": 5e-5}
FOLDER = os.environ.get("LAFAN1_DIR")


@pytest.mark.skipif(not FOLDER, reason="LAFAN1_DIR is not set")
def test_subject_5_gives_the_published_rows(tmp_path: Path) -> None:
    folder = Path(str(FOLDER))
    files = sorted(folder.rglob("*subject[1-5].bvh"))
    assert len(files) == 77, f"{folder} holds {len(files)} of the data set's 77 files"
    tests = [path.name for path in files if path.stem.endswith("subject5")]
    names = {"test": tests, "val": []}
    splits = tmp_path / "splits.json"
    splits.write_text(json.dumps({folder.name: names}))
    ingest(IngestConfig(sources=(str(folder),), output=tmp_path / "motions", format="bvh", splits=splits))
    only = {"tasks": ("transition",), "transitions": GAPS, "protocol": "lafan1"}
    evaluate(EvaluateConfig(motion=tmp_path / "motions", output=tmp_path / "metrics", **only))
    rows, _ = read_metrics(tmp_path / "metrics")
    assert sum(r.windows for r in rows if (r.method, r.interval, r.metric) == ("slerp", 5, "l2q_lafan1")) == 2232
    for method, figures in PUBLISHED.items():
        for metric, values in figures.items():
            for gap, published in zip(GAPS, values, strict=True):
                mine = [r for r in rows if (r.method, r.interval, r.metric) == (method, gap, metric)]
                weights = [r.weight if metric == "npss_lafan1" else r.windows for r in mine]
                found = float(np.average([r.value for r in mine], weights=weights))
                near = max(0.005 * published, HALF_A_DIGIT[metric])
                assert abs(found - published) <= near, f"{method}, {metric}, {gap}: {found} beside {published}"
