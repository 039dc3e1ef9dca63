"""The task on docs/training.md is short and is the one that pumps has; as a package's own task it trains and is
measured."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from data_schemas.metrics import read_metrics
from stages.measure.task.config import Config as MeasureConfig
from stages.measure.task.run import run as measure
from stages.measure.task.summary import BASE
from stages.shared.pose_tasks import registry
from stages.shared.pose_tasks.registry import TASKS, task_names
from stages.train.finetune.config import Config
from stages.train.finetune.run import run
from tests.docs.pages import ROOT
from tests.train.finetune.rig_clouds import RIG, SMALL, write_rig_clouds

PAGE = ROOT / "docs" / "training.md"
CODE = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)[0]


@pytest.fixture
def task(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The page's code as a module of another package, whose entry point names it."""
    module = "tracker_task_of_the_page"
    (tmp_path / f"{module}.py").write_text(CODE)
    monkeypatch.syspath_prepend(str(tmp_path))
    entry = EntryPoint("my-trackers", f"{module}:TrackersTask", registry.ENTRY_POINTS)
    monkeypatch.setattr(registry, "entry_points", lambda group: [entry] if group == entry.group else [])
    yield entry.name
    sys.modules.pop(module, None)


def test_the_page_shows_the_task_of_pumps_in_under_80_lines():
    assert CODE.count("\n") < 80
    own = ROOT / "stages" / "shared" / "pose_tasks" / "trackers.py"
    assert own.read_text(encoding="utf-8") == CODE


def test_the_task_of_the_page_trains_and_is_measured(task: str, tmp_path: Path):
    write_rig_clouds(tmp_path)
    given = {**SMALL, "task": task, "skeleton": RIG, "tpc": tmp_path / "tpc"}
    report = run(Config(**given, output=tmp_path / "made"))
    assert report.figures["finished"] and report.figures["val"]["mpjpe_mm"] > 0
    assert "tracker_task_of_the_page" in sys.modules
    weights = (f"mine={tmp_path / 'made'}",)
    measure(
        MeasureConfig(tpc=tmp_path / "tpc", weights=weights, output=tmp_path / "measured", window=32, device="cpu")
    )
    rows, page = read_metrics(tmp_path / "measured")
    assert {row.method for row in rows} == {BASE, "mine"} and "The task trackers" in page


def test_names_of_packages_are_listed_beside_those_of_pumps(task: str):
    assert task_names() == [*TASKS, task]
