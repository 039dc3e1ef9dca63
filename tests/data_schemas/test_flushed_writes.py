"""Bytes are on the disk before the old file or manifest is replaced, and the new name is before the write returns."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from data_schemas.whole_file import write_whole
from tests.data_schemas.examples import write_motion


@pytest.fixture
def steps(monkeypatch) -> list[str]:
    """What is flushed ("file", "folder") and replaced, in order."""
    found: list[str] = []
    real_fsync, real_replace = os.fsync, os.replace

    def fsync(descriptor):
        found.append("folder" if stat.S_ISDIR(os.fstat(descriptor).st_mode) else "file")
        return real_fsync(descriptor)

    def replace(source, target):
        found.append(f"replace {Path(target).name}")
        return real_replace(source, target)

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(os, "replace", replace)
    return found


def test_a_file(tmp_path, steps):
    write_whole(tmp_path / "a.bvh", b"new")
    assert steps == ["file", "replace a.bvh", "folder"]


def test_an_artefact(tmp_path, steps):
    write_motion(tmp_path / "m")
    swap = steps.index("replace manifest.json")
    # The folder's name; motions.h5, clips.parquet and the marker with their folder; the renamed folder; the manifest.
    assert steps[:swap] == ["folder", "file", "file", "file", "folder", "folder", "file"]
    assert steps[swap + 1] == "folder"
