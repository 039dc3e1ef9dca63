"""Processes that are spawned, as on Windows and macOS, do what forked ones do."""

from __future__ import annotations

import multiprocessing
from pathlib import Path

import pytest

from data_schemas.manifest import open_artefact
from stages.ingest.config import Config
from stages.ingest.run import run
from stages.shared.clips import __file__ as CLIPS_PACKAGE
from stages.shared.pools import process_pool
from stages.shared.threads import process_context

CLIPS = Path(CLIPS_PACKAGE).parent


@pytest.fixture
def spawned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(multiprocessing, "get_all_start_methods", lambda: ["spawn"])


def test_an_ingest_is_the_same(spawned, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    assert process_context().get_start_method() == "spawn"
    sources = (str(CLIPS / "kick.bvh"), str(CLIPS / "punch.bvh"))
    monkeypatch.setattr("stages.shared.formats.reading._POOL_FROM_BYTES", 0)
    for name, workers in (("one", 1), ("two", 2)):
        run(Config(sources=sources, output=tmp_path / name, licence="CC0", workers=workers))
    one, two = (open_artefact(tmp_path / name).manifest.digest for name in ("one", "two"))
    assert one == two


def test_tasks_come_back_in_order(spawned):
    with process_pool(2) as pool:
        assert [*pool.map(abs, [-3, 2, -1])] == [3, 2, 1]
