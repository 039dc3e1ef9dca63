"""Folders made for an output that could not be written are removed, also if making them stopped half way."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from data_schemas.artefact import write_artefact
from data_schemas.errors import PumpsError
from data_schemas.whole_file import write_whole


def _artefact(path: Path) -> None:
    with write_artefact(path, "motion", stage="test", config={}, licences=[]):
        pass


@pytest.mark.parametrize("write", [lambda path: write_whole(path, b"x"), _artefact], ids=["file", "artefact"])
def test_folders_made_half_way_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, write):
    real = os.mkdir

    def full_at_the_third(path, *rest, **more):
        if Path(path).name == "c":
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        return real(path, *rest, **more)

    monkeypatch.setattr(os, "mkdir", full_at_the_third)
    with pytest.raises(PumpsError):
        write(tmp_path / "a" / "b" / "c" / "d")
    assert list(tmp_path.iterdir()) == []
