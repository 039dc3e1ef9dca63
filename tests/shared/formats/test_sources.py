"""Recordings are found in files, folders, globs and archives; hostile archives are refused."""

from __future__ import annotations

import io
import tarfile
import zipfile
from pathlib import Path

import pytest

from data_schemas.errors import InputError
from stages.shared.formats import sources as module
from stages.shared.formats.sources import beside, find_sources, source_named
from stages.shared.many_files.file_runs import names_many
from stages.shared.outputs import paths_in


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


def test_an_archive_that_changed_is_opened_again(tmp_path: Path) -> None:
    path = _archive(tmp_path / "a.zip", {"x.bvh": b"old"})
    assert find_sources([str(path)])[0].read() == b"old"
    _archive(path, {"x.bvh": b"newer", "y.bvh": b"y"})
    assert [source.read() for source in find_sources([str(path)])] == [b"newer", b"y"]


@pytest.mark.parametrize("name", ["../up.bvh", "/abs.bvh", "a/../../b.bvh", "C:/x.bvh", "..\\up.bvh"])
def test_members_that_lead_out_of_the_archive_are_refused(tmp_path: Path, name: str) -> None:
    path = _archive(tmp_path / "evil.zip", {"ok.bvh": b"-", name: b"-"})
    with pytest.raises(InputError, match="leads out"):
        find_sources([str(path)])


def test_members_that_would_fill_the_memory_are_refused(tmp_path: Path) -> None:
    path = _archive(tmp_path / "bomb.zip", {"a.bvh": b"0" * (64 << 20)})
    with pytest.raises(InputError, match="unpack to 67 MB"):
        find_sources([str(path)])


def _tar(path: Path, members: dict[str, bytes], mode: str = "w:gz") -> Path:
    with tarfile.open(path, mode) as archive:  # type: ignore[call-overload]
        for name, data in members.items():
            info = tarfile.TarInfo(name)
            info.size = len(data)
            archive.addfile(info, io.BytesIO(data))
    return path


@pytest.mark.parametrize(
    ("suffix", "mode"),
    [(".tar", "w"), (".tar.gz", "w:gz"), (".tgz", "w:gz"), (".tar.bz2", "w:bz2"), (".tar.xz", "w:xz")],
)
def test_tar_archives_are_read_member_by_member(tmp_path: Path, suffix: str, mode: str) -> None:
    long = "deep/" * 40 + "c.bvh"
    members = {"x/b.bvh": b"b" * 700, "x/a.bvh": b"aa", "x/readme.md": b"-", long: b"c", "__MACOSX/x/a.bvh": b"-"}
    path = _tar(tmp_path / f"all{suffix}", members, mode)
    found = find_sources([str(path)])
    assert [source.member for source in found] == ["x/b.bvh", "x/a.bvh", long]  # as they lie in it
    assert [source.read() for source in reversed(found)] == [b"c", b"aa", b"b" * 700]
    assert found[0].data_set == path.name and source_named(found[1].name).read() == b"aa"
    assert find_sources([str(tmp_path)]) == found, "archives in folders count too"


def test_links_and_devices_in_a_tar_are_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "odd.tar"
    with tarfile.open(path, "w") as archive:
        for name, kind, target in (("a.bvh", tarfile.SYMTYPE, "/etc/passwd"), ("b.bvh", tarfile.LNKTYPE, "a.bvh"),
                                   ("c.bvh", tarfile.CHRTYPE, ""), ("d.bvh", tarfile.REGTYPE, "")):  # fmt: skip
            info = tarfile.TarInfo(name)
            info.type, info.linkname = kind, target
            archive.addfile(info)
    assert [source.member for source in find_sources([str(path)])] == ["d.bvh"]


@pytest.mark.parametrize("name", ["../up.bvh", "/abs.bvh", "a/../../b.bvh"])
def test_tar_members_that_lead_out_of_the_archive_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="leads out"):
        find_sources([str(_tar(tmp_path / "evil.tar.gz", {"ok.bvh": b"-", name: b"-"}))])


def test_tar_bombs_and_damaged_tars_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="unpack to"):
        find_sources([str(_tar(tmp_path / "bomb.tar.gz", {"a.bvh": b"0" * (64 << 20)}))])
    whole = _tar(tmp_path / "whole.tgz", {"a.bvh": bytes(range(256)) * 99, "b.bvh": b"b"}).read_bytes()
    (tmp_path / "cut.tgz").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "none.tgz").write_bytes(b"no archive")
    for name in ("cut.tgz", "none.tgz"):
        with pytest.raises(InputError, match=name):
            [source.read() for source in find_sources([str(tmp_path / name)])]
    header = bytearray(tarfile.TarInfo("a.bvh").tobuf())
    header[124:136] = b"\xff" * 11 + b"\x00"  # a size below zero: a reader that trusts it goes round for ever
    header[148:156] = b"%06o\0 " % (sum(header[:148]) + 8 * 32 + sum(header[156:]))
    (tmp_path / "round.tar").write_bytes(bytes(header) * 3)
    with pytest.raises(InputError, match=r"round\.tar"):
        find_sources([str(tmp_path / "round.tar")])


def test_files_beside_a_recording_are_found(tmp_path: Path) -> None:
    members = {"s/01/01.asf": b"1", "s/01/01_01.amc": b"a", "s/02/02.asf": b"2", "s/02/x.amc": b"b"}
    for path in (_archive(tmp_path / "a.zip", members), _tar(tmp_path / "a.tar.gz", members)):
        first, second = find_sources([str(path)], (".amc",))
        assert [source.read() for source in beside(first, ".asf")] == [b"1"]
        assert [source.read() for source in beside(second, ".asf")] == [b"2"]
    for name, data in members.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(data)
    (source,) = find_sources([str(tmp_path / "s" / "01")], (".amc",))
    assert [each.read() for each in beside(source, ".asf")] == [b"1"]


def test_exclamation_marks_in_names_of_folders_files_and_members(tmp_path: Path) -> None:
    folder = tmp_path / "wow! new"
    other = tmp_path / "a.zip!b"  # a folder whose name looks like a member of an archive
    for each in (folder, other):
        each.mkdir()
    (folder / "x!y.bvh").write_bytes(b"plain")
    (other / "x.bvh").write_bytes(b"in the folder")
    archive = _archive(folder / "c!d.zip", {"m.bvh": b"member", "e!f.zip!g.bvh": b"odd member"})
    named = {
        str(folder / "x!y.bvh"): b"plain",
        str(other / "x.bvh"): b"in the folder",
        f"{archive}!m.bvh": b"member",
        f"{archive}!e!f.zip!g.bvh": b"odd member",
    }
    for name, data in named.items():
        assert source_named(name).read() == data
        (found,) = find_sources([name])
        assert (found.read(), found.name) == (data, name)
    (found,) = find_sources([str(folder / "x*.bvh")])
    assert found.read() == b"plain"
    assert names_many(str(folder / "[!z]*.bvh")) and names_many(str(folder / "*.bvh")) and names_many(str(archive))
    assert not any(map(names_many, named))
    with pytest.raises(InputError, match=r"c!d\.zip has no member 'none\.bvh'"):
        source_named(f"{archive}!none.bvh")
    assert {Path(archive), folder / "x!y.bvh"} <= {*paths_in(f"{archive}!m.bvh"), *paths_in(str(folder / "x!y.bvh"))}


def test_damaged_and_missing_sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "no.zip").write_bytes(b"PK\x03\x04 not really")
    path = _archive(tmp_path / "cut.zip", {"a.bvh": bytes(range(256)) * 999})
    data = bytearray(path.read_bytes())
    data[120:140] = bytes(20)
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"no\.zip is not a zip archive"):
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
    with pytest.raises(InputError, match="not a recording"):
        source.read()
