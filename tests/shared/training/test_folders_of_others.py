"""Folders beside a training's output that are the user's own stay as they are."""

from __future__ import annotations

from pathlib import Path

import pytest

from data_schemas.artefact import partial_folder
from data_schemas.errors import UsageError
from stages.shared.training.unfinished import Unfinished
from stages.train.ae.config import Config


def config_for(output: Path) -> Config:
    return Config(tpc=output.with_name("tpc"), output=output)


@pytest.mark.parametrize("name", ["notes.txt", "checkpoints/mine.pt", "log/diary.txt", "photos/a.jpg"])
def test_a_folder_with_the_users_files_is_refused_and_kept(tmp_path: Path, name: str) -> None:
    file = partial_folder(tmp_path / "ae") / name
    file.parent.mkdir(parents=True)
    file.write_text("mine")
    with pytest.raises(UsageError, match="is not of an unfinished training"):
        Unfinished(config_for(tmp_path / "ae"))
    assert file.read_text() == "mine"


def test_only_what_a_training_kept_is_removed(tmp_path: Path) -> None:
    unfinished = Unfinished(config_for(tmp_path / "ae"))
    for name in ("checkpoints/step_000000001", "log", "windows/abc"):
        (unfinished.folder / name).mkdir(parents=True)
    Unfinished(config_for(tmp_path / "ae"))  # it is a training's
    (unfinished.folder / "added.txt").write_text("mine, added while it ran")
    unfinished.forget()
    assert [path.name for path in unfinished.folder.iterdir()] == ["added.txt"]
    (unfinished.folder / "added.txt").unlink()
    unfinished.forget()
    assert not unfinished.folder.exists()


def test_a_folder_of_the_users_is_not_replaced_when_a_training_is_moved_aside(tmp_path: Path) -> None:
    unfinished = Unfinished(config_for(tmp_path / "ae"))
    (unfinished.folder / "checkpoints" / "step_000000001").mkdir(parents=True)
    (tmp_path / "ae.set-aside").mkdir()
    (tmp_path / "ae.set-aside" / "notes.txt").write_text("mine")
    aside = unfinished._set_aside()
    assert aside.name == "ae.set-aside-2" and (tmp_path / "ae.set-aside" / "notes.txt").read_text() == "mine"
