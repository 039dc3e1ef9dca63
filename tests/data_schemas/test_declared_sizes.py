"""A few bytes that declare millions of frames, rows or numbers are refused before memory is taken for them."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.clips import index_table, read_clips
from data_schemas.declared_sizes import check_stored_array, read_table
from data_schemas.errors import InputError
from data_schemas.motion import MotionReader, MotionWriter
from data_schemas.skeleton import Motion
from tests.data_schemas.examples import a_row, a_skeleton, peak_mb, write_motion

MILLIONS = 5_000_000


def _declare_frames(path: Path, **made: object) -> None:
    """Let the clip of a small artefact declare five million frames."""
    artefact = write_motion(path)
    with h5py.File(artefact.folder / "motions.h5", "a") as file:
        for name, shape in (
            ("rotations", (MILLIONS, 3, 4)),
            ("root_positions", (MILLIONS, 3)),
            ("tracks", (MILLIONS, 1, 3)),
        ):
            del file[f"clips/walk/{name}"]
            file["clips/walk"].create_dataset(name, shape, np.float32, chunks=(256, *shape[1:]), **made)  # type: ignore
            file[f"clips/walk/{name}"][:256] = 0.5  # type: ignore[index]
    pq.write_table(
        index_table([a_row(skeleton=_skeleton_of(path), frames=MILLIONS)]), artefact.folder / "clips.parquet"
    )


def _skeleton_of(path: Path) -> str:
    return read_clips(open_artefact(path).folder)[0].skeleton


@pytest.mark.parametrize("made", [{}, {"compression": "lzf"}, {"compression": "gzip", "compression_opts": 9}])
def test_frames_that_are_not_stored(tmp_path, made):
    _declare_frames(tmp_path / "m", **made)
    before = peak_mb(reset=True)
    with MotionReader(tmp_path / "m") as reader, pytest.raises(InputError, match=r"declares 240 MB, but 0\.0"):
        reader.motion("walk")
    assert peak_mb() - before < 50


def test_frames_that_are_stored_are_read_however_well_they_compress(tmp_path):
    frames = 60_000  # a person who stands still
    still = Motion(
        np.tile(np.array([0, 0, 0, 1], np.float32), (frames, 8, 1)), np.zeros((frames, 3), np.float32), 30.0
    )
    with (
        write_artefact(tmp_path / "m", "motion", stage="s", config={}) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        writer.add_clip(a_row(skeleton=writer.add_skeleton(a_skeleton(8)), frames=frames), still)
    with MotionReader(tmp_path / "m") as reader:
        assert reader.motion("walk").frames == frames


@pytest.mark.parametrize("declared_mb, refused", [(30, False), (60, True)])
def test_gzip_of_equal_bytes_is_bounded(tmp_path, declared_mb, refused):
    """What packed clouds of a body at rest need is read; a thousand times what is stored is not."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        made = file.create_dataset(
            "still", (declared_mb << 18,), np.float32, chunks=(1 << 16,), compression="gzip", compression_opts=9
        )
        for start in range(0, len(made), 1 << 16):
            made[start : start + (1 << 16)] = 0.0
        assert made.id.get_storage_size() * 500 < declared_mb << 20
        if refused:
            with pytest.raises(ValueError, match="declares 63 MB"):
                check_stored_array(made)
        else:
            check_stored_array(made)


def _rows(count: int, **columns: list) -> pa.Table:
    flat = index_table([a_row()]).to_pylist()[0]
    return pa.table(
        {name: columns.get(name) or [value] * count for name, value in flat.items()}, index_table([]).schema
    )


def test_rows_that_repeat(tmp_path):
    pq.write_table(_rows(2_000_000), tmp_path / "clips.parquet", compression="zstd")
    before = peak_mb(reset=True)
    with pytest.raises(InputError, match="declares 2000000 rows"):
        read_clips(tmp_path)
    assert peak_mb() - before < 50


def test_rows_of_one_name_are_refused_before_they_are_made(tmp_path):
    pq.write_table(_rows(9_000), tmp_path / "clips.parquet", compression="zstd")
    with pytest.raises(InputError, match="8999 clips twice"):
        read_clips(tmp_path)


def test_one_long_text_in_every_row(tmp_path):
    dictionary = pa.DictionaryArray.from_arrays(np.zeros(5_000, np.int32), pa.array(["a" * 1_000_000]))
    pq.write_table(pa.table({"reason": dictionary}), tmp_path / "t.parquet", compression="zstd", store_schema=False)
    before = peak_mb(reset=True)
    with pytest.raises(ValueError, match="texts would take 5000 MB"):
        read_table(tmp_path / "t.parquet")
    assert peak_mb() - before < 100


def test_real_indexes_are_read_as_they_were_written(tmp_path):
    rows = [a_row(f"clip {number}", frames=number + 1) for number in range(20_000)]
    pq.write_table(index_table(rows), tmp_path / "clips.parquet", compression="zstd")
    assert read_table(tmp_path / "clips.parquet").equals(index_table(rows).replace_schema_metadata(None))
    assert [asdict(row) for row in read_clips(tmp_path)] == [asdict(row) for row in rows]
