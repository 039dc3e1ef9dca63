"""Whatever is wrong with a data file, the reader says so in one InputError."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from data_schemas.artefact import Artefact, open_artefact, write_artefact
from data_schemas.errors import InputError
from data_schemas.motion import MotionReader
from data_schemas.tpc import TpcReader, TpcWriter
from tests.data_schemas.examples import a_row, some_bones, write_motion


def _read_all(artefact: Artefact) -> None:
    with MotionReader(artefact) as reader:
        for name in reader.skeletons():
            reader.skeleton(name)
        for row in reader.clips:
            reader.motion(row.clip)


def _damage(seed: int, whole: bytes) -> bytes:
    draw = random.Random(seed)
    if seed % 4 == 0:
        return whole[: draw.randrange(len(whole))]
    damaged = bytearray(whole)
    reach = len(whole) if seed % 2 else min(len(whole), 8000)  # half of the damage goes to the file's own structure
    for _ in range(draw.choice((1, 3, 30))):
        damaged[draw.randrange(reach)] = draw.randrange(256)
    return bytes(damaged)


@pytest.mark.parametrize("name", ["motions.h5", "clips.parquet"])
def test_random_damage_gives_one_clear_error_or_none(tmp_path, name):
    artefact = write_motion(tmp_path / "m", frames=300)
    file = artefact.folder / name
    whole = file.read_bytes()
    refused = 0
    for seed in range(150):
        file.write_bytes(_damage(seed, whole))
        try:
            _read_all(artefact)
        except InputError as error:
            refused += 1
            assert str(artefact.path) in error.message
    assert refused > 50


def test_damage_to_stored_frames_is_noticed(tmp_path):
    artefact = write_motion(tmp_path / "m", frames=300)
    file = artefact.folder / "motions.h5"
    with h5py.File(file) as opened:
        offset = opened["clips/walk/rotations"].id.get_chunk_info(0).byte_offset
    whole = bytearray(file.read_bytes())
    whole[offset + 100] ^= 1
    file.write_bytes(whole)
    with pytest.raises(InputError, match=r"motions\.h5 is damaged"):
        _read_all(artefact)


def _replace(name: str, values: object) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        del file[name]
        file[name] = values

    return change


def _link_elsewhere(file: h5py.File) -> None:
    with h5py.File(Path(file.filename).with_name("other.h5"), "w") as other:
        file.copy("clips/walk", other, "walk")
    del file["clips/walk"]
    file["clips/walk"] = h5py.ExternalLink("other.h5", "walk")


def _store_outside(file: h5py.File) -> None:
    del file["clips/walk/root_positions"]
    file["clips/walk"].create_dataset(
        "root_positions", (10, 3), np.float32, external=[("/etc/hostname", 0, h5py.h5f.UNLIMITED)]
    )


CHANGES = {
    "clip lost": lambda file: file.__delitem__("clips/walk"),
    "array lost": lambda file: file.__delitem__("clips/walk/rotations"),
    "array is a group": lambda file: (
        file.__delitem__("clips/walk/rotations"),
        file.create_group("clips/walk/rotations"),
    ),
    "clip is an array": _replace("clips/walk", np.zeros(3)),
    "skeletons lost": lambda file: file.__delitem__("skeletons"),
    "too few frames": _replace("clips/walk/rotations", np.zeros((9, 3, 4), np.float32)),
    "too few joints": _replace("clips/walk/rotations", np.zeros((10, 2, 4), np.float32)),
    "not finite": _replace("clips/walk/root_positions", np.full((10, 3), np.nan)),
    "not unit quaternions": _replace("clips/walk/rotations", np.zeros((10, 3, 4), np.float32)),
    "texts for numbers": _replace("clips/walk/root_positions", np.full((10, 3), b"abc")),
    "track out of range": _replace("clips/walk/track_joints", np.array([99], np.int32)),
    "huge track list": lambda file: (
        file.__delitem__("clips/walk/track_joints"),
        file.create_dataset("clips/walk/track_joints", (2**40,), np.int32, chunks=(1024,)),
    ),
    "link to another file": _link_elsewhere,
    "bytes of another file": _store_outside,
}


@pytest.mark.parametrize("change", CHANGES)
def test_made_up_hdf5(tmp_path, change):
    artefact = write_motion(tmp_path / "m")
    with h5py.File(artefact.folder / "motions.h5", "a") as file:
        CHANGES[change](file)
    with pytest.raises(InputError):
        _read_all(artefact)


@pytest.mark.parametrize("attribute", ["root", "unit_m", "up_axis"])
@pytest.mark.parametrize("value", [None, np.zeros(3), "nan", -7])
def test_made_up_skeleton_attributes(tmp_path, attribute, value):
    artefact = write_motion(tmp_path / "m")
    with h5py.File(artefact.folder / "motions.h5", "a") as file:
        (group,) = file["skeletons"].values()
        del group.attrs[attribute]
        if value is not None:
            group.attrs[attribute] = value
    with pytest.raises(InputError):
        _read_all(artefact)


@pytest.mark.parametrize(
    "change",
    [
        *({"frames": 0}, {"frames": -1}, {"frames": 99}, {"frames": "ten"}, {"fps": 0.0}, {"fps": float("nan")}),
        *(
            {"split": "x"},
            {"clip": "a/b"},
            {"clip": ""},
            {"clip": None},
            {"skeleton": "nobody"},
            {"skeleton": "../clips"},
        ),
    ],
)
def test_made_up_index(tmp_path, change):
    artefact = write_motion(tmp_path / "m")
    file = artefact.folder / "clips.parquet"
    row = pq.ParquetFile(file).read().to_pylist()[0]
    pq.write_table(pa.Table.from_pylist([{**row, **change}]), file)
    with pytest.raises(InputError):
        _read_all(artefact)


def test_index_that_lacks_columns_or_repeats_clips(tmp_path):
    artefact = write_motion(tmp_path / "m")
    file = artefact.folder / "clips.parquet"
    table = pq.ParquetFile(file).read()
    pq.write_table(pa.concat_tables([table, table]), file)
    with pytest.raises(InputError, match="twice"):
        _read_all(artefact)
    pq.write_table(table.drop_columns(["fps", "split"]), file)
    with pytest.raises(InputError, match="lacks the columns fps, split"):
        _read_all(artefact)


@pytest.mark.parametrize("name", ["heads", "rotations"])
def test_clouds_of_made_up_bones(tmp_path, name):
    with write_artefact(tmp_path / "t", "tpc", stage="s", config={}) as draft, TpcWriter(draft.folder) as writer:
        row = a_row(skeleton=writer.add_bones(some_bones()))
        writer.add_rigid(row, np.zeros((10, 2, 3)), np.tile([0, 0, 0, 1], (10, 2, 1)))
    artefact = open_artefact(tmp_path / "t")
    with h5py.File(artefact.file("clouds.h5"), "a") as file:
        stored = file[f"clips/walk/{name}"]
        assert isinstance(stored, h5py.Dataset)
        stored[3] = np.nan if name == "heads" else 0
    with TpcReader(artefact) as reader, pytest.raises(InputError, match=r"clouds\.h5 is damaged"):
        reader.points("walk")
