"""Files of several clips, and archives: the clips are offered, one is opened, and its commands name it."""

from __future__ import annotations

import io
import os
import shlex
import zipfile
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("starlette")
pytest.importorskip("httpx2")

from data_schemas.own_folders import make_own_folder
from stages.registry import stage_named
from stages.shared.formats.bvh import read_bvh
from stages.studio.folder import SESSIONS
from stages.studio.worker import config_of
from tests.shared.formats.gltf_files import GltfText
from tests.studio.bench_in_folder import CLIPS, TOKEN, Page, bench_in

SEVERAL = GltfText(parts=("walk", "-run <b>"), frames=9).data()


def archive(**members: bytes) -> bytes:
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w") as written:
        for name, data in members.items():
            written.writestr(name.replace("_", "."), data)
    return held.getvalue()


ARCHIVE = archive(a_bvh=(CLIPS / "kick.bvh").read_bytes(), b_glb=SEVERAL, c_png=b"nothing")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    folder = tmp_path_factory.mktemp("clips") / "folder"
    with bench_in(folder, "kick") as bench:
        (folder / "several.glb").write_bytes(SEVERAL)
        (folder / "one.glb").write_bytes(GltfText(parts=("walk",)).data())
        (folder / "all.zip").write_bytes(ARCHIVE)
        yield Page(bench)


def opened(page: Page, file: str, clip: str = "") -> Any:
    return page.ask("open", "POST", {"file": file, "clip": clip})


def dropped(page: Page, name: str, data: bytes, clip: str = "") -> Any:
    return page.client.post(f"/{TOKEN}/api/upload", params={"name": name, "clip": clip}, content=data).json()


def saved(page: Page, session: dict[str, Any], name: str) -> Any:
    return page.post(session, "save", motion=session["state"]["motion"], name=name)


def repeated(line: str) -> None:
    """Run a command `pumps export INPUT --clip=NAME -o OUTPUT` in the current folder."""
    _, verb, source, clip, _, output = shlex.split(line)
    values = {"input": source, "clip": (clip.removeprefix("--clip="),), "output": output}
    stage_named(verb).runner()(config_of(verb, values))


def held(page: Page, session: dict[str, Any]) -> bytes:
    return page.bench.sessions.bvh(page.bench.sessions.load(session["id"]), session["state"]["motion"]).read_bytes()


def folders(page: Page) -> set[str]:
    return {path.name for path in (page.bench.folder.path / SESSIONS).iterdir() if path.is_dir()}


@pytest.mark.parametrize("clip", ["", "gone", "walk.glb"])
def test_the_clips_of_a_file_are_offered_and_no_session_begins(page: Page, clip: str) -> None:
    before = folders(page)
    refused = opened(page, "several.glb", clip)
    assert refused["clips"] == ["walk", "-run_<b>"]
    assert refused["told"] == "several.glb holds 2 clips. Choose one."
    assert dropped(page, "other.glb", SEVERAL, clip)["clips"] == ["walk", "-run_<b>"]
    assert folders(page) == before


def test_each_clip_is_opened_as_it_is(page: Page) -> None:
    poses = []
    for clip in ("walk", "-run_<b>"):
        session = opened(page, "several.glb", clip)
        assert session["motions"]["m1"]["name"] == f"{clip} in several.glb"
        assert held(page, session) == held(page, dropped(page, "several.glb", SEVERAL, clip))
        poses.append(read_bvh(held(page, session), clip).values)
    assert abs(poses[0] - poses[1]).max() > 1


def test_a_file_of_one_clip_opens_without_a_choice(page: Page) -> None:
    assert opened(page, "one.glb")["motions"]["m1"]["name"] == "one.glb"
    assert opened(page, "kick.bvh", "any")["motions"]["m1"] == opened(page, "kick.bvh")["motions"]["m1"]


def test_a_chosen_clip_is_saved_with_its_command(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = page.bench.folder.path
    made = saved(page, opened(page, "several.glb", "-run_<b>"), "chosen.bvh")
    assert made["commands"] == ["pumps export several.glb '--clip=several.-run_<b>' -o chosen.bvh"]
    kept = (folder / "chosen.bvh").read_bytes()
    (folder / "chosen.bvh").unlink()
    monkeypatch.chdir(folder)
    repeated(made["commands"][0])
    assert (folder / "chosen.bvh").read_bytes() == kept


def test_an_archive_offers_its_files_and_their_clips(page: Page) -> None:
    for ask in (
        lambda clip: opened(page, "all.zip", clip),
        lambda clip: dropped(page, "all.zip", ARCHIVE, clip),
    ):
        assert ask("")["clips"] == ["a.bvh", "b.glb"]
        assert ask("gone.bvh")["clips"] == ["a.bvh", "b.glb"]
        session = ask("a.bvh")
        assert session["motions"]["m1"]["name"] == "a.bvh"
        assert held(page, session) == (CLIPS / "kick.bvh").read_bytes()
        assert ask("b.glb")["clips"] == ["b.glb!walk", "b.glb!-run_<b>"]
        chosen = ask("b.glb!walk")
        assert held(page, chosen) == held(page, opened(page, "several.glb", "walk"))
    assert opened(page, "all.zip", "a.bvh")["motions"]["m1"]["opened"] == "all.zip!a.bvh"
    assert not [name for name in folders(page) if name.startswith(".")]


def test_a_clip_of_an_archive_is_saved_with_its_command(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = page.bench.folder.path
    made = saved(page, opened(page, "all.zip", "b.glb!walk"), "packed.bvh")
    assert made["commands"] == ["pumps export 'all.zip!b.glb' --clip=b.walk -o packed.bvh"]
    kept = (folder / "packed.bvh").read_bytes()
    (folder / "packed.bvh").unlink()
    monkeypatch.chdir(folder)
    repeated(made["commands"][0])
    assert (folder / "packed.bvh").read_bytes() == kept


def test_an_archive_of_one_file_opens_without_a_choice(page: Page) -> None:
    packed = archive(a_bvh=(CLIPS / "kick.bvh").read_bytes(), c_png=b"nothing")
    assert held(page, dropped(page, "one.zip", packed)) == (CLIPS / "kick.bvh").read_bytes()
    assert dropped(page, "one.zip", packed, "gone")["told"] == "one.zip holds 1 clip. Choose one."
    assert dropped(page, "one.zip", archive(b_glb=SEVERAL))["clips"] == ["b.glb!walk", "b.glb!-run_<b>"]


def test_what_an_ended_studio_left_of_a_dropped_archive_is_removed(page: Page) -> None:
    """A folder of an archive that another studio may be reading, or that pumps did not make, stays."""
    sessions = page.bench.folder.sessions()
    left, young, theirs = (sessions / f".scratch-{name}" for name in ("left", "young", "theirs"))
    for each in (left, young):
        make_own_folder(each)
        (each / "all.zip").write_bytes(ARCHIVE)
    theirs.mkdir()
    (theirs / "all.zip").write_bytes(ARCHIVE)
    for each in (left, theirs):
        os.utime(each, (0, 0))
    assert dropped(page, "one.zip", archive(a_bvh=(CLIPS / "kick.bvh").read_bytes()))["id"]
    assert sorted(sessions.glob(".scratch-*")) == [theirs, young]


@pytest.mark.parametrize(
    ("data", "sentence"), [(archive(c_png=b""), "holds no recording"), (b"PK\3\4 no zip", "all.zip")]
)
def test_an_archive_without_recordings_is_refused(page: Page, data: bytes, sentence: str) -> None:
    before = folders(page)
    assert sentence in dropped(page, "all.zip", data)["error"]
    assert folders(page) == before


def test_a_second_motion_may_be_one_of_several_clips(page: Page) -> None:
    session = opened(page, "kick.bvh")
    about = {"file": "several.glb", "session": session["id"], "revision": session["revision"], "aside": True}
    assert page.ask("open", "POST", about)["clips"] == ["walk", "-run_<b>"]
    aside = page.ask("open", "POST", {**about, "clip": "walk"})
    assert aside["state"]["motion"] == "m1" and "walk in several.glb" in {
        m["name"] for m in aside["motions"].values()
    }
