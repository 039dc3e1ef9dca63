"""Folders described: a file each, a table, processes that end. Imports no torch, so that processes start at once."""

from __future__ import annotations

import csv
import json
import os
import shutil
from pathlib import Path

import pytest

from data_schemas.errors import UsageError
from stages.inspect.config import Config
from stages.inspect.run import run
from stages.shared.contract import StageReport
from stages.shared.many_files.file_runs import TABLE, run_over_files
from stages.shared.progress import SILENT

CLIPS = Path("stages/shared/clips")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "in"
    (made / "inner").mkdir(parents=True)
    shutil.copy(CLIPS / "kick.bvh", made)
    shutil.copy(CLIPS / "punch.bvh", made / "inner")
    text = (CLIPS / "walk.bvh").read_text()
    (made / "slow.bvh").write_text(text.replace("Frame Time: 0.0333", "Frame Time: 0.0733"))
    (made / "bad.bvh").write_text("HIERARCHY\nROOT a\n{\n")
    return made


def _rows_of(out: Path) -> dict[str, dict[str, str]]:
    with open(out / TABLE, newline="") as file:
        return {Path(row["input"]).name: row for row in csv.DictReader(file)}


def test_descriptions_are_those_of_each_file_and_the_table_has_the_problems(folder: Path, tmp_path: Path) -> None:
    run(Config(input=str(folder), output=tmp_path / "out", jobs=1))
    rows = _rows_of(tmp_path / "out")
    assert rows["kick.bvh"]["joints"] == "13" and not rows["kick.bvh"]["problems"]
    assert "unusual rate" in rows["slow.bvh"]["problems"] and rows["bad.bvh"]["status"] == "failed"
    alone = run(Config(input=str(folder / "kick.bvh"))).figures
    assert json.loads((tmp_path / "out/kick.json").read_text()) == json.loads(json.dumps(alone))
    with pytest.raises(UsageError, match="exists"):
        run(Config(input=str(folder / "kick.bvh"), output=tmp_path / "out/kick.json"))
    for taken in ("out.json", "out.bvh"):
        with pytest.raises(UsageError, match="one file"):
            run(Config(input=str(folder), output=tmp_path / taken))


def test_maps_of_a_folder_are_maps(folder: Path, tmp_path: Path) -> None:
    run(Config(input=f"{folder}/*.bvh", output=tmp_path / "maps", map=True, jobs=1))
    alone = run(Config(input=str(folder / "kick.bvh"))).figures
    mapped = run(Config(input=str(folder / "kick.bvh"), skeleton_map=tmp_path / "maps/kick.toml")).figures
    assert mapped["groups"] == alone["groups"]
    assert {found["how"] for what, found in mapped["found"].items() if what == "groups"} == {"map"}


def test_processes_list_the_same_lines(folder: Path) -> None:
    lines = [run(Config(input=str(folder), jobs=jobs)).lines for jobs in (1, 2)]
    assert lines[0] == lines[1] and len(lines[0]) == 5


def _ends_its_process(config: Config) -> StageReport:
    if config.input.endswith("slow.bvh"):
        os._exit(1)
    return run(config)


def test_a_file_that_ends_its_process_costs_no_other(folder: Path, tmp_path: Path) -> None:
    config = Config(input=f"{folder}/[ks]*.bvh", output=tmp_path / "out", jobs=2)
    figures = run_over_files(config, _ends_its_process, SILENT).figures
    assert (figures["written"], figures["failed"]) == (1, 1)
    assert _rows_of(tmp_path / "out")["slow.bvh"]["status"] == "died" and (tmp_path / "out/kick.json").is_file()
    assert run(config.model_copy(update={"jobs": 1})).figures["kept"] == 1
    assert _rows_of(tmp_path / "out")["slow.bvh"]["status"] == "written"
