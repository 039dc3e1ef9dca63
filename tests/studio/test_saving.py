"""Saving: every file is repeated to the byte by the commands that are shown, and no recording is replaced."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("starlette")
pytest.importorskip("httpx2")

from data_schemas.errors import InputError
from stages.registry import stage_named
from stages.studio.config import Config
from stages.studio.folder import Folder
from stages.studio.run import _places, _weights
from stages.studio.session import MotionRecord
from stages.studio.steps import command_line
from stages.studio.worker import config_of
from tests.studio.bench_in_folder import CLIPS, TOKEN, Page, bench_in


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with bench_in(tmp_path_factory.mktemp("saving") / "folder", "kick") as bench:
        yield Page(bench)


def opened(page: Page, file: str) -> dict[str, Any]:
    return page.ask("open", "POST", {"file": file})


def saved(page: Page, session: dict[str, Any], name: str, status: int = 200, **more: Any) -> Any:
    return page.post(session, "save", status, motion=session["state"]["motion"], name=name, **more)


def repeated(line: str) -> None:
    """Run a command of one input, an output and perhaps nothing else, in the current folder."""
    _, *words, source, mark, output = shlex.split(line)
    assert mark == "-o"
    stage = "-".join(words)
    stage_named(stage).runner()(config_of(stage, {"input": source, "output": output}))


@pytest.mark.parametrize("suffix", [".bvh", ".glb", ".npz", ".csv", ".parquet", ".GLB"])
@pytest.mark.parametrize("edited", [False, True])
def test_every_format_is_written_again(
    page: Page, suffix: str, edited: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Some formats hold the name of the clip, which is that of the file that was converted."""
    folder, session = page.bench.folder.path, opened(page, "kick.bvh")
    if edited:
        assert page.wait(page.post(session, "edit", verb="mirror", options={}))["state"] == "done"
        session = page.session(session)
    stem = f"again-{suffix[1:]}-{edited}"
    made = saved(page, session, stem + suffix)
    files = [name for name in made["files"] if not name.endswith(".sh")]
    assert files[0] == stem + suffix.lower()
    kept = {name: (folder / name).read_bytes() for name in files}
    if not made["commands"]:  # a recording as it is
        assert (suffix, edited) == (".bvh", False) and kept == {f"{stem}.bvh": (folder / "kick.bvh").read_bytes()}
        return
    for name in files:
        (folder / name).unlink()
    monkeypatch.chdir(folder)
    for line in made["commands"]:
        repeated(line)
    assert {name: (folder / name).read_bytes() for name in files} == kept


def test_other_formats_and_dropped_files_are_written_again(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = page.bench.folder.path
    saved(page, opened(page, "kick.bvh"), "other.glb")
    dropped = page.client.post(f"/{TOKEN}/api/upload?name=d.glb", content=(folder / "other.glb").read_bytes()).json()
    held = page.bench.sessions.folder(dropped["id"])
    assert sorted(path.name for path in held.iterdir() if path.name[0] != ".") == ["m1.bvh", "session.json"]
    monkeypatch.chdir(folder)
    for number, session in enumerate((opened(page, "other.glb"), dropped)):
        made = saved(page, session, f"more{number}.parquet")
        kept = (folder / f"more{number}.parquet").read_bytes()
        for name in made["files"]:
            (folder / name).unlink()
        for line in made["commands"]:
            repeated(line)
        assert (folder / f"more{number}.parquet").read_bytes() == kept


def test_a_recording_that_has_changed_is_read_from_the_session(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = page.bench.folder.path
    shutil.copy(folder / "kick.bvh", folder / "changing.bvh")
    session = opened(page, "changing.bvh")
    shutil.copy(CLIPS / "jump.bvh", folder / "changing.bvh")
    made = saved(page, session, "unchanged.csv")
    assert made["commands"] == [f"pumps export .pumps-studio/{session['id']}/m1.bvh -o unchanged.csv"]
    kept = (folder / "unchanged.csv").read_bytes()
    (folder / "unchanged.csv").unlink()
    monkeypatch.chdir(folder)
    repeated(made["commands"][0])
    assert (folder / "unchanged.csv").read_bytes() == kept


@pytest.mark.parametrize(("recording", "name"), [("kick.bvh", "kick.BVH"), ("odd!x.bvh", "odd!x.bvh")])
def test_no_spelling_of_its_name_replaces_a_recording(page: Page, recording: str, name: str) -> None:
    folder = page.bench.folder.path
    shutil.copy(CLIPS / "kick.bvh", folder / recording)
    session = opened(page, recording)
    assert page.wait(page.post(session, "edit", verb="mirror", options={}))["state"] == "done"
    session = page.session(session)
    assert "recording" in saved(page, session, name, 400, overwrite=True)["error"]
    if name != recording:
        assert "exists" in saved(page, session, name, 400)["error"]
    assert (folder / recording).read_bytes() == (CLIPS / "kick.bvh").read_bytes()


def test_weights_are_named_so_that_the_folder_finds_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "run" / "ae").mkdir(parents=True)
    (tmp_path / "run" / "ae" / "manifest.json").write_text("{}")
    monkeypatch.chdir(tmp_path)
    assert _weights("run") == str(tmp_path / "run")
    assert _weights("small-free") == "small-free"
    with pytest.raises(InputError, match="no weights"):
        _weights("none-such")


def test_the_folder_is_that_of_the_recording_though_a_name_has_a_mark(tmp_path: Path) -> None:
    inner = tmp_path / "a!b"
    inner.mkdir()
    shutil.copy(CLIPS / "kick.bvh", inner)
    folder, first = _places(Config.model_validate({"input": inner / "kick.bvh"}))
    assert (folder.path, first) == (inner, "kick.bvh")
    folder, first = _places(Config.model_validate({"input": inner / "kick.bvh", "folder": tmp_path}))
    assert (folder.path, first) == (Folder(tmp_path).path, "a!b/kick.bvh")


@pytest.mark.parametrize(
    "changed", [{"options": {"output": "other.bvh", "overwrite": True}}, {"stage": "weights-pack"}]
)
def test_a_session_of_another_person_adds_no_option_to_commands(changed: dict[str, Any]) -> None:
    record = MotionRecord(name="m", stage="infill", options={"seed": 1, "device": "cpu"}, source="m1")
    assert command_line(record, "a.bvh", "b.bvh") == "pumps infill a.bvh --seed=1 --device=cpu -o b.bvh"
    with pytest.raises(InputError, match="damaged"):
        command_line(record.model_copy(update=changed), "a.bvh", "b.bvh")


def test_an_export_that_fails_leaves_the_folder_as_it_was(page: Page) -> None:
    page.bench.folder.new_file("many.bvh", False).write_bytes((CLIPS / "kick.bvh").read_bytes())
    session = opened(page, "many.bvh")
    session = page.wait(page.post(session, "edit", verb="mirror", options={})) and page.session(session)
    folder = page.bench.folder.path
    (folder / "wrong.bvh").write_bytes(b"earlier")
    before = {path: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    (folder / "wrong.glb").mkdir()
    assert "exists" in saved(page, session, "wrong.glb", 400, overwrite=True)["error"]
    (folder / "wrong.glb").rmdir()
    motion = page.bench.sessions.bvh(page.bench.sessions.load(session["id"]), session["state"]["motion"])
    whole = motion.read_bytes()
    motion.write_bytes(whole[:-200])  # damaged on the disk, so that it cannot be exported
    try:
        assert saved(page, session, "wrong.glb", 404, overwrite=True)["error"]
    finally:
        motion.write_bytes(whole)
    assert {path: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before
    assert not list(page.bench.folder.sessions().glob(".scratch-*"))
