"""Recordings are found in files, folders, globs and archives; hostile archives are refused."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from data_schemas.errors import InputError
from stages.formats import sources as module
from stages.formats.sources import find_sources, source_named


def _archive(path: Path, members: dict[str, bytes], **options: int) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def test_everything_is_found_once_in_order(tmp_path: Path) -> None:
    folder = tmp_path / "mocap"
    (folder / "deep").mkdir(parents=True)
    (folder / "b.bvh").write_bytes(b"b")
    (folder / "deep" / "a.BVH").write_bytes(b"a")
    (folder / "notes.txt").write_bytes(b"-")
    archive = _archive(tmp_path / "more.zip", {"more/2.bvh": b"22", "more/1.bvh": b"1", "more/readme.md": b"-"})
    found = find_sources([str(folder), str(archive), str(tmp_path / "*.zip"), str(folder / "b.bvh")])
    assert [source.member for source in found] == ["b.bvh", "deep/a.BVH", "more/1.bvh", "more/2.bvh"]
    assert [source.read() for source in found] == [b"b", b"a", b"1", b"22"]
    assert [source.data_set for source in found] == ["mocap", "mocap", "more.zip", "more.zip"]
    assert found[2].name == f"{archive}!more/1.bvh"
    assert all(source_named(source.name).read() == source.read() for source in found)
    assert find_sources([found[3].name]) == [found[3]]


def test_an_archive_that_changed_is_opened_anew(tmp_path: Path) -> None:
    path = _archive(tmp_path / "a.zip", {"x.bvh": b"old"})
    assert find_sources([str(path)])[0].read() == b"old"
    _archive(path, {"x.bvh": b"newer", "y.bvh": b"y"})
    assert [source.read() for source in find_sources([str(path)])] == [b"newer", b"y"]


@pytest.mark.parametrize("name", ["../up.bvh", "/abs.bvh", "a/../../b.bvh", "C:/x.bvh", "..\\up.bvh"])
def test_members_that_climb_out_are_refused(tmp_path: Path, name: str) -> None:
    path = _archive(tmp_path / "evil.zip", {"ok.bvh": b"-", name: b"-"})
    with pytest.raises(InputError, match="climbs out"):
        find_sources([str(path)])


def test_members_that_would_fill_the_memory_are_refused(tmp_path: Path) -> None:
    path = _archive(tmp_path / "bomb.zip", {"a.bvh": b"0" * (64 << 20)})
    with pytest.raises(InputError, match="unpack to 67 MB"):
        find_sources([str(path)])


def test_damaged_and_missing_sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "no.zip").write_bytes(b"PK\x03\x04 not really")
    path = _archive(tmp_path / "cut.zip", {"a.bvh": bytes(range(256)) * 999})
    data = bytearray(path.read_bytes())
    data[120:140] = bytes(20)
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"no\.zip is no zip archive"):
        find_sources([str(tmp_path / "no.zip")])
    with pytest.raises(InputError, match="damaged"):
        find_sources([str(path)])[0].read()
    for missing in ("nowhere.bvh", "*.nothing", "cut.zip!b.bvh"):
        with pytest.raises(InputError):
            find_sources([str(tmp_path / missing)])
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="no recordings"):
        find_sources([str(tmp_path / "empty")])
    (tmp_path / "big.bvh").write_bytes(b"12345")
    source = find_sources([str(tmp_path / "big.bvh")])[0]
    monkeypatch.setattr(module, "MAX_FILE_BYTES", 4)
    with pytest.raises(InputError, match="no recording"):
        source.read()
