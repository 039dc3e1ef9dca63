"""The makefile as a DAG: a change reruns what depends on it and nothing else; a failed run goes on where it was."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

from stages.registry import PIPELINE, downstream_of
from tests.docs.pages import commands
from tests.pipeline.made_runs import ROOT, Run

ALL = {stage.name for stage in PIPELINE}
FIELDS = {
    "ingest": "strict=true", "sample-tpc": "points=99", "train-ae": "encoder.width=8", "encode": "half=false",
    "train-lms": "steps=9", "data-pick": "count=2", "infill": "keyframes=every:7", "decode": "points=64",
    "evaluate": "window=61", "report": "keyframes=every:3",
}  # fmt: skip


@pytest.fixture
def run(tmp_path: Path, light_python: tuple[str, ...]) -> Run:
    return Run(tmp_path, light_python)


def in_order(ran: Sequence[str]) -> bool:
    """Whether every stage ran after all that it needs (among those that ran)."""
    return all(
        ran.index(need) < ran.index(stage.name)
        for stage in PIPELINE
        if stage.name in ran
        for need in stage.needs
        if need in ran
    )


def test_the_whole_dag_runs_once_in_order_and_then_no_more(run: Run):
    ran = run.make()
    assert set(ran) == ALL and in_order(ran)
    assert sorted(ran) == sorted([*ALL, "infill"]), "infill once for each of two clips, all else once"
    assert run.make() == []


def test_a_setting_reruns_exactly_what_depends_on_it(run: Run):
    assert set(FIELDS) == ALL
    run.make()
    settings: list[str] = []
    for stage, field in FIELDS.items():
        settings.append(f"{stage}.{field}")
        assert set(run.make(*settings)) == downstream_of({stage}), stage
    assert run.make(*settings) == []


def test_a_source_that_changes_comes_or_goes_reruns_all(run: Run):
    run.make()
    (run.data / "a.bvh").write_text("HIERARCHY another")
    assert set(run.make()) == ALL
    (run.data / "c.bvh").write_text("HIERARCHY c")
    assert set(run.make()) == ALL
    (run.data / "c.bvh").unlink()
    assert set(run.make()) == ALL
    (run.data / "splits.json").write_text('{"data": {}}')
    assert set(run.make()) == ALL
    assert run.make() == []


def test_a_source_that_is_only_touched_reruns_nothing(run: Run):
    run.make()
    os.utime(run.data / "a.bvh")
    assert run.make() == []


@pytest.mark.parametrize("stage", ["train-lms", "infill"])
def test_a_run_that_failed_goes_on_where_it_was(run: Run, stage: str):
    first = run.make(fail=stage, code=2)
    rest = run.make()
    assert stage in rest
    assert not (set(first) - {stage}) & set(rest), "what was finished is not done again"
    assert run.make() == []


def test_weights_that_are_compared_fill_the_clips_and_are_played(run: Run):
    ran = run.make(flags=["COMPARE=small-free"])
    assert sorted(ran) == sorted([*ALL, "infill", "infill", "infill"]), (
        "two clips, by the run's weights and the shipped"
    )
    assert "--motions one/small-free=" in run.said and "two/small-free=" in run.said
    assert run.make(flags=["COMPARE=small-free"]) == []
    assert set(run.make()) == {"evaluate", "report"}, "without them, only what showed them is made again"


def test_jobs_at_once_keep_the_order(run: Run):
    ran = run.make(flags=["-j4"])
    assert set(ran) == ALL and in_order(ran)
    assert run.make(flags=["-j4"]) == []
    assert "jobserver" not in run.said, "the run's own make shares the jobs"


def test_a_missing_source_is_told_before_anything_runs(run: Run):
    run.data = run.data / "nowhere"
    assert run.make(code=2) == []


def documented_targets() -> list[str]:
    """Targets that the makefile's head, its .PHONY line or a page names."""
    text = (ROOT / "Makefile").read_text()
    phony = re.search(r"^\.PHONY: (.*)$", text, re.M)
    assert phony
    named = {line.split()[1] for _, line in commands() if line.startswith("make ")}
    return sorted({*phony[1].split(), *named})


def test_the_makefile_is_short():
    assert len((ROOT / "Makefile").read_text().splitlines()) < 180


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a fresh clone holds, except for the weights: no data beside it, no .venv, no runs."""
    folder = tmp_path_factory.mktemp("fresh") / "clone"
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=True,
    ).stdout.decode()
    for name in listed.split("\0"):
        if name and not name.endswith(".safetensors") and (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, folder / name)
    return folder


@pytest.mark.parametrize("target", documented_targets())
def test_make_shows_what_any_target_would_do_in_a_fresh_clone(clone: Path, target: str):
    before = sorted(clone.rglob("*"))
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("MAKE", "MFLAGS"))}
    shown = subprocess.run(["make", "-n", target], cwd=clone, env=kept, capture_output=True, text=True)
    assert shown.returncode == 0 and shown.stdout.strip() and not shown.stderr, shown.stdout + shown.stderr
    assert sorted(clone.rglob("*")) == before, "make -n does nothing"
