"""Checkpoints and metrics: round trips, and clear errors for damage."""

from __future__ import annotations

import pickle
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from data_schemas.artefact import open_artefact, verify, write_artefact
from data_schemas.checkpoint import Checkpoint, read_checkpoint, read_checkpoint_folder, write_checkpoint
from data_schemas.errors import InputError
from data_schemas.metrics import MetricRow, read_metrics, write_metrics

arrays = st.dictionaries(
    st.text(st.characters(categories=("L", "N"), include_characters="._"), min_size=1, max_size=20).filter(
        lambda name: name != "__metadata__"
    ),
    hnp.arrays(
        st.sampled_from([np.float32, np.float16, np.int64, np.bool_]),
        hnp.array_shapes(min_dims=0, max_dims=3, max_side=5),
    ),
    max_size=5,
)


def _write(path: Path, **changes) -> None:
    content = {
        "weights": {"layer.weight": np.ones((2, 3), np.float32)},
        "config": {"width": 32},
        "optimiser": {"step": np.array(7), "layer.weight.exp_avg": np.zeros((2, 3), np.float32)},
        "log": [{"step": 1, "loss": 0.5}, {"step": 2, "loss": 0.25, "validation": 0.3}],
        "card": "# A model\n",
        **changes,
    }
    with write_artefact(path, "checkpoint", stage="train-ae", config={}) as draft:
        write_checkpoint(draft.folder, **content)


@settings(deadline=None, max_examples=25)
@given(arrays, arrays | st.none(), st.booleans())
def test_checkpoint_round_trip(weights, optimiser, turned):
    if turned:  # strided views are written as what they show
        weights = {name: values.T for name, values in weights.items()}
    with tempfile.TemporaryDirectory() as folder:
        write_checkpoint(folder, weights=weights, config={"a": [1, None]}, optimiser=optimiser, log=[], card="é")
        got = read_checkpoint_folder(folder)
        lean = read_checkpoint_folder(folder, optimiser=False)
    assert (got.config, got.log, got.card) == ({"a": [1, None]}, [], "é")
    assert lean.optimiser is None and (got.optimiser is None) == (optimiser is None)
    for given_arrays, got_arrays in ((weights, got.weights), (optimiser or {}, got.optimiser or {})):
        assert set(given_arrays) == set(got_arrays)
        for name, values in given_arrays.items():
            np.testing.assert_array_equal(got_arrays[name], values)
            assert got_arrays[name].dtype == values.dtype


def test_checkpoint_artefact(tmp_path):
    _write(tmp_path / "c")
    got = read_checkpoint(tmp_path / "c")
    assert isinstance(got, Checkpoint)
    assert got.log == [{"step": 1, "loss": 0.5}, {"step": 2, "loss": 0.25, "validation": 0.3}]
    assert got.optimiser is not None and got.optimiser["step"] == 7 and got.optimiser["step"].shape == ()
    assert read_checkpoint(open_artefact(tmp_path / "c"), optimiser=False).optimiser is None
    first = open_artefact(tmp_path / "c").manifest.digest
    _write(tmp_path / "c")
    assert open_artefact(tmp_path / "c").manifest.digest == first
    assert verify(tmp_path / "c") == []


@pytest.mark.parametrize("name", ["model.safetensors", "optimiser.safetensors", "config.json", "log.parquet"])
@pytest.mark.parametrize("content", [b"", b"{", b"\xff" * 100, b"\x08\0\0\0\0\0\0\0[1,2,3]]", pickle.dumps({"a": 1})])
def test_damaged_checkpoint_files_are_named(tmp_path, name, content):
    _write(tmp_path / "c")
    artefact = open_artefact(tmp_path / "c")
    (artefact.folder / name).write_bytes(content)
    with pytest.raises(InputError, match=name):
        read_checkpoint(artefact)


def test_missing_checkpoint_files_are_named(tmp_path):
    _write(tmp_path / "c")
    artefact = open_artefact(tmp_path / "c")
    (artefact.folder / "model.safetensors").unlink()
    with pytest.raises(InputError, match=r"model\.safetensors is missing"):
        read_checkpoint(artefact)
    with pytest.raises(InputError, match=r"model\.safetensors is missing"):
        read_checkpoint(tmp_path / "c")


def test_a_training_may_remember_infinity(tmp_path):
    _write(tmp_path / "c", config={"best_loss": float("inf")})
    assert read_checkpoint(tmp_path / "c").config == {"best_loss": float("inf")}


metric_rows = st.builds(
    MetricRow,
    clip=st.text(max_size=10),
    skeleton=st.text(max_size=10),
    archive=st.text(max_size=10),
    method=st.text(max_size=10),
    task=st.text(max_size=10),
    interval=st.integers(0, 1000),
    metric=st.text(max_size=10),
    value=st.floats(allow_nan=False),
    weight=st.floats(allow_nan=False),
    windows=st.integers(0, 2**40),
)


@settings(deadline=None, max_examples=25)
@given(st.lists(metric_rows, max_size=5), st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\r")))
def test_metrics_round_trip(rows, summary):
    with tempfile.TemporaryDirectory() as folder:
        with write_artefact(Path(folder) / "m", "metrics", stage="evaluate", config={}) as draft:
            write_metrics(draft.folder, rows, summary)
        assert read_metrics(Path(folder) / "m") == (rows, summary)
        assert read_metrics(open_artefact(Path(folder) / "m")) == (rows, summary)


def test_damaged_metrics_are_named(tmp_path):
    with write_artefact(tmp_path / "m", "metrics", stage="evaluate", config={}) as draft:
        write_metrics(
            draft.folder, [MetricRow("walk", "s", "a", "slerp", "interpolation", 15, "l2p_m", 0.1)], "# table"
        )
    artefact = open_artefact(tmp_path / "m")
    (artefact.folder / "metrics.parquet").write_bytes(b"PAR1")
    with pytest.raises(InputError, match=r"metrics\.parquet is damaged"):
        read_metrics(artefact)
    with pytest.raises(InputError, match="'checkpoint' artefact is needed"):
        read_checkpoint(artefact)


def test_large_checkpoints_lie_in_shards(tmp_path, monkeypatch):
    monkeypatch.setattr("data_schemas.checkpoint.SHARD_BYTES", 5000)
    rng = np.random.default_rng(0)
    arrays = {f"layer{n}": rng.normal(size=(300,)).astype(np.float32) for n in range(9)}
    arrays["large"] = rng.normal(size=3000)  # never cut
    _write(tmp_path / "c", weights=arrays, optimiser=arrays)
    folder = open_artefact(tmp_path / "c").folder
    shards = sorted(folder.glob("model-*.safetensors"))
    assert len(shards) > 3 and not (folder / "model.safetensors").exists()
    assert shards[0].name == f"model-00001-of-{len(shards):05d}.safetensors"
    assert all(path.stat().st_size < 5000 for path in shards[1:])
    got = read_checkpoint(tmp_path / "c")
    for kept in (got.weights, got.optimiser):
        assert kept is not None and set(kept) == set(arrays)
        for name, values in arrays.items():
            np.testing.assert_array_equal(kept[name], values)
    shards[1].unlink()
    with pytest.raises(InputError, match="is missing"):
        read_checkpoint(tmp_path / "c")
