"""Artefacts and files are written where there are no POSIX locks, permissions and flushes of folders."""

from __future__ import annotations

from pathlib import Path

import pytest

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.errors import PumpsError
from data_schemas.whole_file import write_whole
from data_schemas.write_lock import LOCK_NAME, write_lock
from tests.other_systems.stand_ins import as_on_windows


def _write(path: Path, text: str) -> None:
    with write_artefact(path, "metrics", stage="s", config={}) as draft:
        (draft.folder / "summary.md").write_text(text)


def test_artefacts_and_files_are_written_and_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    stand_in = as_on_windows(monkeypatch)
    for text in ("first", "second"):
        _write(tmp_path / "a", text)
        write_whole(tmp_path / "b.bvh", text.encode())
    assert (open_artefact(tmp_path / "a").folder / "summary.md").read_text() == "second"
    assert (tmp_path / "b.bvh").read_bytes() == b"second"
    assert not stand_in.held and not (tmp_path / "a" / LOCK_NAME).exists()


def test_another_process_that_writes_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    as_on_windows(monkeypatch)
    with write_lock(tmp_path):
        monkeypatch.setattr("data_schemas.write_lock._held", set())  # as another process sees it
        with pytest.raises(PumpsError, match="being written by another"), write_lock(tmp_path):
            pass
    with write_lock(tmp_path):
        pass
    assert not list(tmp_path.iterdir())


def test_the_lock_file_of_a_killed_process_does_not_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    as_on_windows(monkeypatch)
    (tmp_path / LOCK_NAME).touch()
    with write_lock(tmp_path):
        pass


def test_where_there_are_no_locks_at_all_one_process_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    as_on_windows(monkeypatch)
    monkeypatch.setattr("data_schemas.write_lock.msvcrt", None)
    _write(tmp_path / "a", "first")
    with write_lock(tmp_path), pytest.raises(PumpsError), write_lock(tmp_path):
        pass
