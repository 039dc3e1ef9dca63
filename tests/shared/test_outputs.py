"""The rule for outputs that exist: refused, replaced on request, and never an input."""

from __future__ import annotations

import os
import socket
import stat
import threading
from pathlib import Path

import pytest

from data_schemas.artefact import write_artefact
from data_schemas.errors import UsageError
from stages.shared.contract import WritingConfig
from stages.shared.outputs import check_artefact, check_file, check_folder, check_written, write_output


class Settings(WritingConfig):
    """Of a command with every kind of input."""

    output: Path
    input: str = ""
    motions: tuple[str, ...] = ()
    weights: Path | None = None


@pytest.fixture
def there(tmp_path: Path) -> Path:
    path = tmp_path / "walk.bvh"
    path.write_bytes(b"x")
    return path


def test_a_file_that_exists_needs_overwrite(there: Path) -> None:
    check_file(Settings(output=there.with_name("other.bvh")))
    with pytest.raises(UsageError, match=r"walk\.bvh exists\. Give --overwrite"):
        check_file(Settings(output=there))
    check_file(Settings(output=there, overwrite=True))


@pytest.mark.parametrize("form", ["{}", "{}!inside/walk.bvh"])
def test_an_input_is_not_replaced_even_with_overwrite(there: Path, form: str) -> None:
    text = form.format(there)
    for given in ({"input": text}, {"motions": ("a=b", text)}, {"motions": (f"scene/truth={there}",)}):
        with pytest.raises(UsageError, match=f"{there} is given as (input|motions) too"):
            check_file(Settings.model_validate({"output": there, "overwrite": True, **given}))


def test_an_input_by_another_path_is_the_same_file(there: Path, tmp_path: Path) -> None:
    link = tmp_path / "link.bvh"
    link.symlink_to(there)
    with pytest.raises(UsageError, match="given as input too"):
        check_file(Settings(output=link, input=str(there), overwrite=True))


def test_a_folder_is_not_written_as_a_file(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="is a folder"):
        check_file(Settings(output=tmp_path, overwrite=True))


def test_a_suffix_that_is_not_written_names_those_that_are(tmp_path: Path) -> None:
    for name, said in (("out.fbx", "the suffix .fbx"), ("out", "no suffix")):
        with pytest.raises(UsageError, match=rf"{name} has {said}.*Name a file of \.bvh, \.glb\."):
            check_file(Settings(output=tmp_path / name), (".bvh", ".glb"))
    check_file(Settings(output=tmp_path / "OUT.BVH"), (".bvh", ".glb"))


def test_an_artefact_that_exists_needs_overwrite_and_its_own_kind(tmp_path: Path, there: Path) -> None:
    place = tmp_path / "made"
    check_artefact(Settings(output=place), "metrics")
    with write_artefact(place, "metrics", stage="evaluate", config={}) as draft:
        (draft.folder / "summary.md").write_bytes(b"x")
    with pytest.raises(UsageError, match="made exists"):
        check_artefact(Settings(output=place), "metrics")
    check_artefact(Settings(output=place, overwrite=True), "metrics")
    with pytest.raises(UsageError, match="must not replace it"):
        check_artefact(Settings(output=place, overwrite=True), "motion")
    with pytest.raises(UsageError, match="given as weights too"):
        check_artefact(Settings(output=place, overwrite=True, weights=place), "metrics")
    with pytest.raises(UsageError, match="is a file; an artefact is a folder"):
        check_artefact(Settings(output=there, overwrite=True), "metrics")


def test_a_folder_with_files_needs_overwrite(tmp_path: Path, there: Path) -> None:
    empty = tmp_path / "empty"
    check_folder(Settings(output=empty))
    empty.mkdir()
    (empty / ".hidden").touch()
    check_folder(Settings(output=empty))
    with pytest.raises(UsageError, match="exists"):
        check_folder(Settings(output=tmp_path))
    check_folder(Settings(output=tmp_path, overwrite=True))
    with pytest.raises(UsageError, match="is a file"):
        check_folder(Settings(output=there, overwrite=True))


def test_overwrite_is_not_stored_with_the_settings(there: Path) -> None:
    assert "overwrite" not in Settings(output=there, overwrite=True).model_dump()
    with pytest.raises(UsageError, match="exists"):
        check_written(Settings(output=there), there)


def test_a_member_of_a_named_archive_is_an_input(there: Path) -> None:
    with pytest.raises(UsageError, match="given as motions too"):
        check_file(Settings(output=there, motions=(f"scene/truth={there}!inside/walk.bvh",), overwrite=True))


def test_a_hard_link_to_an_input_is_the_same_file(there: Path, tmp_path: Path) -> None:
    os.link(there, tmp_path / "hard.bvh")
    with pytest.raises(UsageError, match="given as input too"):
        check_file(Settings(output=tmp_path / "hard.bvh", input=str(there), overwrite=True))


def test_a_part_of_an_artefact_that_is_read_is_not_replaced(tmp_path: Path) -> None:
    place = tmp_path / "weights" / "ae"
    with write_artefact(place, "metrics", stage="evaluate", config={}) as draft:
        (draft.folder / "summary.md").write_bytes(b"x")
    (part,) = place.glob("data-*/summary.md")
    for given in (place, place.parent):
        for path in (part, place / "manifest.json"):
            with pytest.raises(UsageError, match=r"is a part of .*given as weights, and must not be replaced"):
                check_file(Settings(output=path, weights=given, overwrite=True))
    (place / "page.html").write_bytes(b"the user's own file beside it")
    check_file(Settings(output=place / "page.html", weights=place, overwrite=True))


def test_a_link_is_written_through_and_stays(there: Path, tmp_path: Path) -> None:
    link = tmp_path / "link.bvh"
    link.symlink_to(there.name)
    with pytest.raises(UsageError, match=r"link\.bvh exists"):
        check_file(Settings(output=link))
    check_file(Settings(output=link, overwrite=True))
    write_output(link, b"new")
    assert link.is_symlink() and there.read_bytes() == b"new" and not there.is_symlink()


def test_a_link_that_leads_nowhere_is_refused(tmp_path: Path) -> None:
    for name, to in (("gone.bvh", "absent"), ("loop.bvh", "loop.bvh")):
        link = tmp_path / name
        link.symlink_to(to)
        for attempt in (lambda: check_file(Settings(output=link, overwrite=True)), lambda: write_output(link, b"x")):  # noqa: B023
            with pytest.raises(UsageError, match="is a link that leads to no file"):
                attempt()
        assert link.is_symlink()
    assert not (tmp_path / "absent").exists()


def test_a_device_is_written_to_and_stays(tmp_path: Path) -> None:
    link = tmp_path / "nothing.bvh"
    link.symlink_to(os.devnull)
    for path in (Path(os.devnull), link):
        check_file(Settings(output=path))
        write_output(path, b"x")
    assert stat.S_ISCHR(os.stat(os.devnull).st_mode) and link.is_symlink()


def test_a_pipe_is_written_to_and_stays(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.bvh"
    os.mkfifo(pipe)
    read: list[bytes] = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_bytes()))
    reader.start()
    check_file(Settings(output=pipe))
    write_output(pipe, b"all of it")
    reader.join(10)
    assert read == [b"all of it"] and stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_socket_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # the path of a socket must be short
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("s.bvh")
        with pytest.raises(UsageError, match="is a disk or a socket"):
            check_file(Settings(output=Path("s.bvh"), overwrite=True))
        with pytest.raises(UsageError, match="is a disk or a socket"):
            write_output(Path("s.bvh"), b"x")
