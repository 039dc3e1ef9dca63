"""Only what pumps made is removed or replaced: not a person's folders, links or devices of the same names."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from data_schemas.artefact import verify
from data_schemas.errors import UsageError
from data_schemas.own_folders import MARKER_NAME, is_own_folder, make_own_folder, remove_own_folder
from data_schemas.whole_file import write_whole
from tests.data_schemas.examples import write_text_artefact

NAMES = ["data-0123456789abcdef", "data-0123456789abcdef-2", ".draft-0123456789abcdef"]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("there_before", [True, False])
def test_a_persons_own_folder_is_refused_and_kept(tmp_path, name, there_before):
    if there_before:
        write_text_artefact(tmp_path / "a", "old")
    (tmp_path / "a" / name).mkdir(parents=True)
    (tmp_path / "a" / name / "thesis.txt").write_text("mine")
    with pytest.raises(UsageError, match=f"{name} has a name that pumps uses") as caught:
        write_text_artefact(tmp_path / "a", "new")
    assert "Move it" in str(caught.value.hint)
    assert (tmp_path / "a" / name / "thesis.txt").read_text() == "mine"
    if there_before:
        assert verify(tmp_path / "a") == []
    (tmp_path / "a" / name).rename(tmp_path / "elsewhere")
    write_text_artefact(tmp_path / "a", "new")


@pytest.mark.parametrize("name", NAMES)
def test_a_link_or_file_of_such_a_name_is_refused_and_kept(tmp_path, name):
    (tmp_path / "a").mkdir()
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "thesis.txt").write_text("mine")
    (tmp_path / "a" / name).symlink_to(tmp_path / "home")
    with pytest.raises(UsageError, match=name):
        write_text_artefact(tmp_path / "a", "new")
    assert (tmp_path / "a" / name / "thesis.txt").read_text() == "mine"
    (tmp_path / "a" / name).unlink()
    (tmp_path / "a" / name).write_text("mine")
    with pytest.raises(UsageError, match=name):
        write_text_artefact(tmp_path / "a", "new")


def test_leftovers_with_the_marker_are_removed(tmp_path):
    first = write_text_artefact(tmp_path / "a", "old")
    for name in NAMES:
        make_own_folder(tmp_path / "a" / name)
        (tmp_path / "a" / name / "half.h5").write_text("half")
    (tmp_path / "a" / "data-fedcba9876543210").mkdir()  # a kill between the making and the marking leaves it empty
    second = write_text_artefact(tmp_path / "a", "new")
    assert {each.name for each in (tmp_path / "a").iterdir()} == {"manifest.json", second.manifest.data}
    assert not first.folder.exists() and (second.folder / MARKER_NAME).is_file()


def test_the_old_data_of_an_artefact_without_markers_are_removed(tmp_path):
    old = write_text_artefact(tmp_path / "a", "old")
    (old.folder / MARKER_NAME).unlink()  # as an older pumps wrote it
    new = write_text_artefact(tmp_path / "a", "new")
    assert {each.name for each in (tmp_path / "a").iterdir()} == {"manifest.json", new.manifest.data}


def test_a_folder_whose_removal_was_interrupted_is_still_known(tmp_path, monkeypatch):
    make_own_folder(tmp_path / "own")
    (tmp_path / "own" / "a").write_text("x")
    (tmp_path / "own" / "b").mkdir()
    monkeypatch.setattr("data_schemas.own_folders.shutil.rmtree", lambda *a, **k: (_ for _ in ()).throw(OSError))
    remove_own_folder(tmp_path / "own")
    assert is_own_folder(tmp_path / "own")


def test_files_named_like_a_lock_are_kept(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / ".lock").write_text("mine")
    write_text_artefact(tmp_path / "a", "x")
    assert (tmp_path / "a" / ".lock").read_text() == "mine"


def test_a_manifest_that_is_a_link_is_not_replaced(tmp_path):
    name = "manifest.json"
    other = write_text_artefact(tmp_path / "other", "x")
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / name).symlink_to(other.path / name)
    with pytest.raises(UsageError, match="that pumps did not write"):
        write_text_artefact(tmp_path / "a", "y")
    assert (tmp_path / "a" / name).is_symlink()


def test_links_and_devices_are_not_replaced_by_files(tmp_path):
    target = tmp_path / "target.bvh"
    target.write_text("mine")
    (tmp_path / "link.bvh").symlink_to(target)
    (tmp_path / "dangling.bvh").symlink_to(tmp_path / "nothing")
    os.mkfifo(tmp_path / "pipe.bvh")
    for name, words in (("link.bvh", "is a link"), ("dangling.bvh", "is a link"), ("pipe.bvh", "not a plain file")):
        with pytest.raises(UsageError, match=words):
            write_whole(tmp_path / name, b"new")
    with pytest.raises(UsageError, match="not a plain file"):
        write_whole(Path("/dev/null"), b"new")
    assert target.read_text() == "mine" and (tmp_path / "link.bvh").is_symlink()
    assert not (tmp_path / "nothing").exists() and not (tmp_path / "pipe.bvh").is_file()
    assert not Path("/dev/null").is_file()
