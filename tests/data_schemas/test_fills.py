"""Filled windows in an evaluation's artefact: what is read is what was written, but for rounding."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_schemas.artefact import write_artefact
from data_schemas.errors import InputError
from data_schemas.fills import FILLS_NAME, LARGEST_STEP, FilledBatch, FillsReader, FillsWriter, kept_joints
from data_schemas.kinds import KINDS
from data_schemas.metrics import MetricRow, read_metrics, write_metrics
from data_schemas.skeleton import NO_GROUP
from tests.evaluate.swaying import skeleton

RIG = skeleton()
JOINTS = kept_joints(RIG)


def batch(windows: int, frames: int) -> FilledBatch:
    known = np.arange(frames) % 5 == 0
    return FilledBatch(
        0, "set", "interpolation", 5, "", tuple(f"c{n}" for n in range(windows)), (7,) * windows, known
    )


def poses(seed: int, windows: int, frames: int, size_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Poses that jump by up to the whole range from frame to frame, so that differences exceed 16 bits."""
    rng = np.random.default_rng(seed)
    positions = rng.uniform(-size_m, size_m, (windows, frames, RIG.joints, 3)).astype(np.float32)
    rotations = rng.normal(size=(windows, frames, RIG.joints, 4)).astype(np.float32)
    return positions, rotations / np.linalg.norm(rotations, axis=-1, keepdims=True)


def written(folder: Path, of: FilledBatch, origins: np.ndarray, **made: tuple[np.ndarray, np.ndarray]) -> Path:
    with write_artefact(folder, "metrics", stage="evaluate", config={}) as draft:
        write_metrics(
            draft.folder, [MetricRow("c0", "s", "set", "slerp", "interpolation", 5, "l2p_m", 0.1)], "# It\n"
        )
        with FillsWriter(draft.folder, 30.0) as fills:
            fills.begin(of, RIG, origins)
            for name, filled in made.items():
                fills.add(name, *filled)
    return folder


@settings(max_examples=12, deadline=None)
@given(
    st.integers(0, 2**31), st.integers(1, 3), st.integers(1, 20), st.floats(0.01, 50), st.floats(-1e3, 1e3)
)  # fmt: skip
def test_positions_and_rotations_come_back(tmp_path_factory, seed, windows, frames, size_m, far):
    positions, rotations = poses(seed, windows, frames, size_m)
    origins = np.full((windows, 3), far, np.float32)
    folder = written(tmp_path_factory.mktemp("fills") / "m", batch(windows, frames), origins,
                     made=(positions + np.float32(far), rotations))  # fmt: skip
    with FillsReader(folder) as reader:
        (found,) = reader.batches
        read_positions, read_rotations = reader.poses(found, "made")
        assert reader.skeleton(found.skeleton).names == RIG.names
    step = np.abs(positions).max() / LARGEST_STEP + 4e-7 * abs(far)  # half a step, and what float32 holds so far out
    assert np.abs(read_positions - far - positions[:, :, JOINTS]).max() <= step
    assert np.abs(read_rotations - rotations[:, :, JOINTS]).max() < 5e-5
    np.testing.assert_allclose(np.linalg.norm(read_rotations, axis=-1), 1, atol=1e-6)


def test_the_index_lists_batches_and_some_windows_are_read_alone(tmp_path):
    of, (positions, rotations) = batch(3, 11), poses(1, 3, 11, 1.0)
    folder = written(tmp_path / "m", of, np.zeros((3, 3)), slerp=(positions, rotations), mine=(-positions, rotations))
    assert read_metrics(folder)[0][0].value == 0.1
    with FillsReader(folder) as reader:
        (found,) = reader.batches
        assert (found.methods, found.clips, found.starts, found.task) == (
            ("slerp", "mine"), ("c0", "c1", "c2"), (7, 7, 7), "interpolation",
        )  # fmt: skip
        np.testing.assert_array_equal(found.known, of.known)
        whole, _ = reader.poses(found, "mine")
        np.testing.assert_array_equal(reader.poses(found, "mine", slice(1, 2))[0], whole[1:2])
        with pytest.raises(InputError, match="keeps no fills of other"):
            reader.poses(found, "other")
    assert (RIG.groups == NO_GROUP).any() and whole.shape[2] == len(JOINTS)


def test_still_motion_takes_little(tmp_path):
    positions, rotations = (np.repeat(part[:, :1], 121, axis=1) for part in poses(2, 8, 1, 1.0))
    folder = written(tmp_path / "m", batch(8, 121), np.zeros((8, 3)), made=(positions, rotations))
    with FillsReader(folder) as reader:
        assert reader.artefact.file(FILLS_NAME).stat().st_size < 0.1 * 2 * 7 * 8 * 121 * len(JOINTS) + 40_000


def test_an_evaluation_without_fills_says_how_to_keep_them(tmp_path, monkeypatch):
    for version in (2, 3):
        with monkeypatch.context() as then:
            then.setitem(KINDS, "metrics", KINDS["metrics"]._replace(schema_version=version))
            with write_artefact(tmp_path / "m", "metrics", stage="evaluate", config={}) as draft:
                write_metrics(draft.folder, [], "# It\n")
        assert read_metrics(tmp_path / "m") == ([], "# It\n")
        with pytest.raises(InputError, match="keeps no filled windows") as caught:
            FillsReader(tmp_path / "m")
        assert "--keep-fills" in str(caught.value.hint)


def test_values_that_are_not_finite_are_refused_and_nothing_is_left(tmp_path):
    positions, rotations = poses(3, 1, 5, 1.0)
    positions[0, 2, JOINTS[0]] = np.nan
    with pytest.raises(InputError, match="mine made values that are not finite"):
        written(tmp_path / "m", batch(1, 5), np.zeros((1, 3)), mine=(positions, rotations))
    assert not (tmp_path / "m").exists()


@pytest.mark.parametrize("damage", ["cut", "joints", "clips", "zero"])
def test_damage_is_an_input_error(tmp_path, damage):
    folder = written(tmp_path / "m", batch(2, 9), np.zeros((2, 3)), made=poses(4, 2, 9, 1.0))
    with FillsReader(folder) as reader:
        path = reader.artefact.file(FILLS_NAME)
    if damage == "cut":
        path.write_bytes(path.read_bytes()[:500])
    else:
        with h5py.File(path, "r+") as file:
            changed: dict[str, tuple[str, np.ndarray]] = {
                "joints": ("batches/0/methods/0/positions", np.zeros((2, 9, 3, 3), np.int16)),
                "zero": ("batches/0/methods/0/rotations", np.zeros((2, 9, len(JOINTS), 4), np.int16)),
                "clips": ("batches/0/clips", np.frombuffer(b"c0", np.uint8)),
            }
            name, values = changed[damage]
            del file[name]
            file[name] = values
    with pytest.raises(InputError, match="damaged"), FillsReader(folder) as reader:
        reader.poses(reader.batches[0], "made")


def test_a_method_that_comes_twice_is_damage(tmp_path):
    made = poses(5, 1, 5, 1.0)
    with write_artefact(tmp_path / "m", "metrics", stage="evaluate", config={}) as draft:
        write_metrics(draft.folder, [], "")
        with FillsWriter(draft.folder, 30.0) as fills:
            fills.begin(replace(batch(1, 5), task="transition"), RIG, np.zeros((1, 3)))
            fills.add("slerp", *made)
            fills.add("slerp", *made)
    with pytest.raises(InputError, match="a method comes twice"):
        FillsReader(tmp_path / "m")
