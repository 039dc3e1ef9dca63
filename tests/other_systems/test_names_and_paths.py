"""Paths with spaces, backslashes and great lengths; names that differ by case alone; texts with CRLF."""

from __future__ import annotations

import os
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

import pumps
from stages.edit.mirror.config import Config as MirrorConfig
from stages.edit.mirror.run import run as mirror
from stages.shared.clips import __file__ as CLIPS_PACKAGE
from stages.shared.settings.presets import file_layer
from stages.shared.settings.recipes import read_recipe
from stages.shared.toml import toml_values
from tests.conftest import Ran

CLIPS = Path(CLIPS_PACKAGE).parent
PLACES = {
    "spaces": "my takes (1)/walk  no 1",
    "backslashes": "a\\b/..\\walk",
    "other alphabets": "動作/Übung",
    "long": "/".join(["f" * 200] * 6) + "/" + "w" * 240,
}


@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES)
def test_commands_read_and_write_at_such_paths(place: str, tmp_path: Path, pumps: Callable[..., Ran]):
    def run(*words: object) -> None:
        assert pumps(*words).code == 0

    source, plain = tmp_path / f"{place}.bvh", tmp_path / "plain.bvh"
    source.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(CLIPS / "kick.bvh", source)
    output = source.parent / "of it" / source.name
    run("edit", "mirror", source, "-o", output)
    run("edit", "mirror", CLIPS / "kick.bvh", "-o", plain)
    assert output.read_bytes() == plain.read_bytes()
    run("ingest", "auto", source, "-o", source.parent / "its motion", "--licence", "CC0", "--workers", "1")
    run("artefact", "verify", source.parent / "its motion")
    run("run", "--source", source.parent, "--run", source.parent / "its run", "--dry-run")


def test_names_that_differ_by_case_alone_have_outputs_that_do_not(tmp_path: Path):
    """On a file system that takes both for one, the second would replace the first."""
    archive = tmp_path / "takes.zip"
    with zipfile.ZipFile(archive, "w") as file:
        for name in ("a/walk.bvh", "A/walk.bvh", "a/Walk.BVH"):
            file.write(CLIPS / "kick.bvh", name)
    mirror(MirrorConfig(input=archive, output=tmp_path / "out", jobs=1))
    written = [path.relative_to(tmp_path / "out").as_posix() for path in (tmp_path / "out").rglob("*.[bB]*")]
    assert len(written) == len({name.casefold() for name in written}) == 3


@pytest.mark.parametrize("clip", ["kick.bvh", "walk.bvh"])
def test_a_bvh_with_crlf_is_the_same_motion(clip: str, tmp_path: Path):
    unix, windows = tmp_path / "unix.bvh", tmp_path / "windows.bvh"
    text = (CLIPS / clip).read_bytes().replace(b"\r\n", b"\n")
    unix.write_bytes(text)
    windows.write_bytes(text.replace(b"\n", b"\r\n"))
    assert (pumps.load(unix).positions == pumps.load(windows).positions).all()


def test_settings_and_recipes_with_crlf_are_the_same(tmp_path: Path):
    presets = CLIPS.parent / "presets"
    for path in (presets / "tiny.toml", presets / "recipes" / "latents.toml"):
        text = path.read_bytes()
        assert b"\r" not in text
        assert toml_values(text.replace(b"\n", b"\r\n").decode()) == toml_values(text.decode())
    own = tmp_path / "own.toml"
    own.write_bytes((presets / "recipes" / "latents.toml").read_bytes().replace(b"\n", b"\r\n"))
    assert read_recipe(str(own)).nodes == read_recipe("latents").nodes
    own.write_bytes((presets / "tiny.toml").read_bytes().replace(b"\n", b"\r\n"))
    assert file_layer(own, "train-ae").values == file_layer(presets / "tiny.toml", "train-ae").values


def test_no_name_in_the_repository_is_one_file_with_another():
    """A clone on a file system that ignores case would lack one of them."""
    root = CLIPS.parents[2]
    for folder, folders, files in os.walk(root):
        folders[:] = [each for each in folders if each not in (".git", "runs", ".venv", "__pycache__", ".hypothesis")]
        names = [each.casefold() for each in (*folders, *files)]
        assert len(names) == len(set(names)), folder
