"""The same content has the same digest, ten times of ten, whatever the compressed bytes and the clocks are."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from data_schemas.artefact import open_artefact, verify, write_artefact
from data_schemas.checkpoint import read_checkpoint, write_checkpoint
from data_schemas.content_digest import content_digest
from data_schemas.trainings import Training
from tests.data_schemas.large_artefacts import WRITERS

KINDS = [kind for kind in WRITERS if kind != "file"]


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_run_ten_times(tmp_path, kind):
    digests = set()
    for number in range(10):
        # What lies in memory between runs is what LZF's table starts from.
        noise = np.random.default_rng(number).bytes(100_000)
        WRITERS[kind](tmp_path / "out", 0)
        digests.add(open_artefact(tmp_path / "out").manifest.digest)
        assert len(noise) == 100_000 and verify(tmp_path / "out") == []
    assert len(digests) == 1


def _hdf5(
    path: Path, compression: str | None, value: float = 1.0, dtype: type = np.float32, attribute: str = "a"
) -> str:
    with h5py.File(path, "w") as file:
        group = file.create_group("clips/walk")
        values = np.arange(9000, dtype=dtype).reshape(3000, 3)
        values[1500, 1] = value
        group.create_dataset("places", data=values, chunks=(256, 3), compression=compression)
        group.attrs["encoder"] = attribute
    found = content_digest(path, "motion")
    assert found is not None
    return found


def test_hdf5_is_digested_by_what_it_holds(tmp_path):
    path = tmp_path / "a.h5"
    same = {_hdf5(path, compression) for compression in (None, "lzf", "gzip")}
    assert len(same) == 1
    others = [
        _hdf5(path, "lzf", value=2.0),
        _hdf5(path, "lzf", value=-0.0),
        _hdf5(path, "lzf", value=0.0),
        _hdf5(path, "lzf", dtype=np.float64),
        _hdf5(path, "lzf", attribute="b"),
    ]
    assert len({*same, *others}) == 6


def _table(path: Path, values: dict, **settings) -> str:
    pq.write_table(pa.table(values), path, **settings)
    found = content_digest(path, "metrics")
    assert found is not None
    return found


def test_tables_are_digested_by_what_they_hold(tmp_path):
    path = tmp_path / "a.parquet"
    values = {"name": ["a", "bc", None], "value": [1.5, None, 0.0], "flag": [True, False, None], "count": [1, 2, 3]}
    settings = [{}, {"compression": "zstd"}, {"use_dictionary": False}, {"row_group_size": 1}, {"version": "1.0"}]
    same = {_table(path, values, **each) for each in settings}
    assert len(same) == 1
    changed = [
        {"name": ["ab", "c", None]}, {"name": ["a", "bc", ""]}, {"value": [1.5, 0.0, 0.0]},
        {"flag": [True, False, False]}, {"count": [1.0, 2.0, 3.0]}, {"count": [3, 2, 1]},
    ]  # fmt: skip
    assert len({*same, *(_table(path, {**values, **each}) for each in changed)}) == 1 + len(changed)


def _checkpoint(path: Path, minutes: float, **changes) -> str:
    content = {
        "weights": {"layer": np.ones(3, np.float32)},
        "config": {"width": 3, "place": {"step": 2, "seconds": 60 * minutes}},
        "optimiser": None,
        "log": [{"step": 1, "seconds": 60 * minutes, "loss": 0.5}],
        "card": f"{minutes} minutes",
        "trainings": (Training(steps=2, minutes=minutes),),
        **changes,
    }
    with write_artefact(path, "checkpoint", stage="train-ae", config={}) as draft:
        write_checkpoint(draft.folder, **content)
    return open_artefact(path).manifest.digest


def test_a_checkpoints_digest_knows_no_clock_and_the_checkpoint_does(tmp_path):
    path = tmp_path / "c"
    same = {_checkpoint(path, minutes) for minutes in (1.0, 2.0)}
    assert len(same) == 1
    kept = read_checkpoint(path)
    assert (kept.trainings[0].minutes, kept.log[0]["seconds"], kept.card) == (2.0, 120.0, "2.0 minutes")
    others = [
        _checkpoint(path, 1.0, weights={"layer": np.zeros(3, np.float32)}),
        _checkpoint(path, 1.0, config={"width": 4}),
        _checkpoint(path, 1.0, log=[{"step": 1, "seconds": 60.0, "loss": 0.25}]),
        _checkpoint(path, 1.0, trainings=(Training(steps=3, minutes=1.0),)),
    ]
    assert len({*same, *others}) == 5


def test_clocks_are_still_covered_by_verify(tmp_path):
    _checkpoint(tmp_path / "c", 1.0)
    folder = open_artefact(tmp_path / "c").folder
    config = json.loads((folder / "config.json").read_text())
    config["trainings"][0]["minutes"] = 9.0
    (folder / "config.json").write_text(json.dumps(config))
    (folder / "MODEL_CARD.md").write_text("9 minutes")
    assert [problem.split()[0] for problem in verify(tmp_path / "c")] == ["MODEL_CARD.md", "config.json"]
