"""Formats that are not read are named by their content, with the way to go; nothing is unpickled."""

from __future__ import annotations

import io
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch

from data_schemas.errors import InputError
from stages.shared.formats.readers import format_named, read_recordings, recognise
from stages.shared.formats.recording import Asked
from stages.shared.formats.sources import find_sources, source_named
from stages.shared.formats.unread_formats import UNREAD, unread_format
from tests.shared.formats.hostile import TARGETS


class _Bomb:
    """Creates a file when it is unpickled."""

    def __init__(self, path: Path):
        self.path = path

    def __reduce__(self) -> tuple:
        return open, (str(self.path), "w")


def _torch_file(value: object, *, old: bool = False) -> bytes:
    stream = io.BytesIO()
    torch.save(value, stream, _use_new_zipfile_serialization=not old)
    return stream.getvalue()


def _c3d() -> bytes:
    return b"\x02\x50" + np.array([30, 0, 1, 100], "<u2").tobytes() + bytes(502)


CONTENTS: dict[str, tuple[bytes, str]] = {
    "FBX": (b"Kaydara FBX Binary  \0\x1a\0", "FBX"),
    "FBX text": (b"; FBX 7.4.0 project file\n", "FBX"),
    "VRML": (b"#VRML V2.0 utf8\n", "VRML"),
    "USD": (b"#usda 1.0\n", "USD"),
    "USD binary": (b"PXR-USDC\0\0", "USD"),
    "Alembic": (b"Ogawa\xff\0\1", "Alembic"),
    "COLLADA": (b'<?xml version="1.0"?>\n<COLLADA xmlns="">', "COLLADA"),
    "Blender": (b"BLENDER-v300", "a Blender scene"),
    "VMD": (b"Vocaloid Motion Data 0002\0\0\0\0\0miku", "MikuMikuDance motion"),
    "C3D": (_c3d(), "C3D"),
    "MOT": (
        b"Coordinates\nversion=1\nnRows=2\nnColumns=2\ninDegrees=yes\nendheader\ntime\tknee\n",
        "an OpenSim table",
    ),
    "MVNX": (b'<?xml version="1.0"?><mvnx version="4">', "Xsens MVN motion"),
    "MATLAB": (b"MATLAB 5.0 MAT-file, Platform: GLNXA64", "MATLAB data"),
    "HDF5": (b"\x89HDF\r\n\x1a\n\0\0", "HDF5"),
    "Parquet": (b"PAR1\x15\x04", "Parquet"),
    "PyTorch": (_torch_file({"poses": torch.zeros(3)}), "a PyTorch file"),
    "PyTorch, old": (_torch_file({"poses": torch.zeros(3)}, old=True), "a PyTorch file"),
    "pickle": (pickle.dumps({"poses": np.zeros(3)}), "a pickle of Python"),
    "pickle of 2": (pickle.dumps([1.0], protocol=2), "a pickle of Python"),
}


@pytest.mark.parametrize("kind", CONTENTS)
def test_recognised_by_content(kind: str) -> None:
    data, what = CONTENTS[kind]
    for name in ("walk.bvh", "walk", "walk.npz"):  # whatever the file is called
        with pytest.raises(InputError, match=what) as caught:
            recognise(data, name)
        assert name in caught.value.message and "does not read it" in caught.value.message and caught.value.hint


@pytest.mark.parametrize("suffix", sorted({suffix for each in UNREAD for suffix in each.suffixes}))
def test_recognised_by_suffix_where_the_content_says_nothing(suffix: str) -> None:
    with pytest.raises(InputError, match="does not read it"):
        recognise(b"\1\2\3", f"walk{suffix.upper()}")
    assert unread_format(b"\1\2\3", f"walk{suffix}", by_suffix=False) is None


def test_a_recording_with_a_foreign_suffix_is_read_as_what_it_is() -> None:
    for target in TARGETS.values():
        data, _ = target.make(np.random.default_rng(1))
        assert unread_format(data, "x", by_suffix=False) is None
    data, _ = TARGETS["bvh"].make(np.random.default_rng(1))
    found = recognise(b"HIERARCHY\n" + data, "walk.fbx")
    assert found is not None and found.name == "bvh"


def test_the_reader_that_is_named_says_so_too(tmp_path: Path) -> None:
    path = tmp_path / "walk.npz"
    path.write_bytes(CONTENTS["PyTorch"][0])
    with pytest.raises(InputError, match="a PyTorch file"):
        read_recordings(path.read_bytes(), source_named(str(path)), format_named("amass"), Asked())


def test_nothing_is_unpickled(tmp_path: Path) -> None:
    bomb = tmp_path / "run"
    inside = io.BytesIO()
    with zipfile.ZipFile(inside, "w") as archive:
        archive.writestr("archive/data.pkl", pickle.dumps(_Bomb(bomb)))
    for data in (pickle.dumps(_Bomb(bomb)), inside.getvalue(), _torch_file(_Bomb(bomb), old=True)):
        with pytest.raises(InputError, match="does not read it"):
            recognise(data, "walk.pkl")
    assert not bomb.exists()


def test_a_folder_or_archive_of_them_alone_is_named_too(tmp_path: Path) -> None:
    folder = tmp_path / "clips"
    (folder / "in").mkdir(parents=True)
    (folder / "notes.txt").write_text("nothing")
    (folder / "in" / "walk.vmd").write_bytes(b"Vocaloid Motion Data 0002")
    with zipfile.ZipFile(tmp_path / "clips.zip", "w") as archive:
        archive.write(folder / "in" / "walk.vmd", "in/walk.vmd")
    for source in (folder, tmp_path / "clips.zip"):
        with pytest.raises(InputError, match=r"in/walk\.vmd is MikuMikuDance motion") as raised:
            find_sources([str(source)])
        assert "MMD Tools" in (raised.value.hint or "")
    (folder / "in" / "walk.vmd").unlink()
    with pytest.raises(InputError, match="holds no recordings"):
        find_sources([str(folder)])
