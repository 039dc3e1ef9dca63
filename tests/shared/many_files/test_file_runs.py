"""Folders, patterns and archives: one output a file, bad files reported, killed runs resumed, nothing overwritten."""

from __future__ import annotations

import csv
import json
import shutil
import zipfile
from pathlib import Path

import pytest

from data_schemas.errors import InputError, UsageError
from stages.edit.mirror.config import Config
from stages.edit.mirror.run import run
from stages.export.config import Config as ExportConfig
from stages.export.run import run as export
from stages.shared.contract import StageReport
from stages.shared.many_files.file_runs import JOURNAL, TABLE, names_many

CLIPS = Path("stages/shared/clips")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "in"
    (made / "inner").mkdir(parents=True)
    for name, place in (("kick", "."), ("punch", "inner"), ("walk", "inner")):
        shutil.copy(CLIPS / f"{name}.bvh", made / place / f"{name}.bvh")
    (made / "splits.json").write_text("{}")
    (made / "bad.bvh").write_text("HIERARCHY\nROOT a\n{\n")
    return made


def mirrored(source: Path, output: Path, **options) -> dict:
    return reported(source, output, **options).figures


def reported(source: Path, output: Path, **options) -> StageReport:
    return run(Config(input=source, output=output, jobs=options.pop("jobs", 1), **options))


def rows_of(out: Path) -> dict[str, dict[str, str]]:
    with open(out / TABLE, newline="") as file:
        return {Path(row["input"]).name: row for row in csv.DictReader(file)}


def test_each_file_is_as_if_it_were_given_alone_and_a_bad_one_is_reported(folder: Path, tmp_path: Path):
    report = reported(folder, tmp_path / "out")
    figures = report.figures
    assert (figures["files"], figures["written"], figures["failed"]) == (4, 3, 1)
    assert report.lines[0].count("bad.bvh") == 1
    mirrored(CLIPS / "punch.bvh", tmp_path / "alone.bvh")
    assert (tmp_path / "out/inner/punch.bvh").read_bytes() == (tmp_path / "alone.bvh").read_bytes()
    rows = rows_of(tmp_path / "out")
    assert rows["bad.bvh"]["status"] == "failed" and rows["bad.bvh"]["reason"]
    assert rows["kick.bvh"]["frames"] == "46" and not (tmp_path / "out/bad.bvh").exists()


def test_processes_write_the_same_bytes(folder: Path, tmp_path: Path):
    mirrored(folder, tmp_path / "one")
    mirrored(folder, tmp_path / "two", jobs=2)
    for name in ("kick.bvh", "inner/punch.bvh", "inner/walk.bvh"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_a_killed_run_goes_on(folder: Path, tmp_path: Path):
    out = tmp_path / "out"
    mirrored(folder, out)
    whole = {path: path.read_bytes() for path in out.rglob("*.bvh")}
    # As a kill leaves it: one file is done, one is there without its line, the last line is cut.
    lines = (out / JOURNAL).read_bytes().splitlines(keepends=True)
    kept = next(line for line in lines if b"kick.bvh" in line and b"sha256" in line)
    (out / JOURNAL).write_bytes(lines[0] + kept + lines[-1][:20])
    (out / "inner/walk.bvh").unlink()
    (out / TABLE).unlink()
    untouched = (out / "kick.bvh").stat().st_mtime_ns
    figures = mirrored(folder, out)
    assert figures["kept"] == 1 and figures["written"] == 2
    assert (out / "kick.bvh").stat().st_mtime_ns == untouched
    assert {path: path.read_bytes() for path in out.rglob("*.bvh")} == whole
    assert len(rows_of(out)) == 4


def test_a_changed_input_is_run_again(folder: Path, tmp_path: Path):
    out = tmp_path / "out"
    mirrored(folder, out)
    shutil.copy(CLIPS / "crawl.bvh", folder / "kick.bvh")
    assert mirrored(folder, out)["written"] == 1


def test_what_others_wrote_is_not_replaced(folder: Path, tmp_path: Path):
    out = tmp_path / "out"
    (out / "inner").mkdir(parents=True)
    (out / "inner/walk.bvh").write_text("mine")
    with pytest.raises(UsageError):
        mirrored(folder, out)
    assert (out / "inner/walk.bvh").read_text() == "mine" and not (out / "kick.bvh").exists()
    assert mirrored(folder, out, overwrite=True)["written"] == 3


def test_other_settings_do_not_replace_what_is_there(folder: Path, tmp_path: Path):
    mirrored(folder, tmp_path / "out")
    with pytest.raises(UsageError):
        mirrored(folder, tmp_path / "out", across="x")


def test_archives_and_patterns(folder: Path, tmp_path: Path):
    archive = tmp_path / "takes.zip"
    with zipfile.ZipFile(archive, "w") as file:
        file.write(folder / "kick.bvh", "a/kick.bvh")
        file.write(folder / "inner/punch.bvh", "b/kick.bvh")
    assert mirrored(archive, tmp_path / "out")["written"] == 2
    assert (tmp_path / "out/a/kick.bvh").is_file() and (tmp_path / "out/b/kick.bvh").is_file()
    assert mirrored(folder / "inner/*.bvh", tmp_path / "other", suffix=".glb")["written"] == 2
    assert (tmp_path / "other/walk.glb").is_file()


def test_two_files_of_one_name_have_two_outputs(folder: Path, tmp_path: Path):
    shutil.copy(CLIPS / "run.bvh", folder / "kick2.bvh")
    mirrored(folder / "kick2.bvh", folder / "kick.glb")
    mirrored(folder, tmp_path / "out", suffix=".bvh")
    head = json.loads((tmp_path / "out" / JOURNAL).read_text().splitlines()[0])
    assert len(set(head["outputs"])) == len(head["outputs"]) == 6


def test_one_file_as_output_is_refused(folder: Path, tmp_path: Path):
    with pytest.raises(UsageError):
        mirrored(folder, tmp_path / "out.bvh")


def test_nothing_usable_is_an_error(tmp_path: Path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in/bad.bvh").write_text("HIERARCHY")
    with pytest.raises(InputError):
        mirrored(tmp_path / "in", tmp_path / "out")


def test_what_counts_as_many(folder: Path):
    assert names_many(str(folder)) and names_many(f"{folder}/*.bvh")
    assert not names_many(str(folder / "kick.bvh")) and not names_many("takes.zip!a[1].bvh")


def test_a_name_that_a_spreadsheet_takes_for_a_formula_is_text_in_the_table(tmp_path: Path, monkeypatch):
    (tmp_path / "=1+1").mkdir()
    shutil.copy(CLIPS / "kick.bvh", tmp_path / "=1+1" / "kick.bvh")
    monkeypatch.chdir(tmp_path)
    mirrored(Path("=1+1"), tmp_path / "out")
    (row,) = rows_of(tmp_path / "out").values()
    assert row["input"].startswith("'=1+1")


def test_a_folder_that_is_read_is_not_written_over(folder: Path):
    before = {path: path.read_bytes() for path in folder.rglob("*.bvh")}
    with pytest.raises(UsageError, match="must not be replaced"):
        mirrored(folder, folder, overwrite=True)
    assert {path: path.read_bytes() for path in folder.rglob("*.bvh")} == before


def test_results_inside_the_folder_that_is_read_are_no_inputs(folder: Path):
    for _ in range(3):
        assert mirrored(folder, folder / "out")["files"] == 4
    assert sorted(str(path.relative_to(folder / "out")) for path in (folder / "out").rglob("*.bvh")) == [
        "inner/punch.bvh", "inner/walk.bvh", "kick.bvh",
    ]  # fmt: skip


def test_an_empty_folder_is_an_error(tmp_path: Path):
    (tmp_path / "in").mkdir()
    with pytest.raises(InputError):
        mirrored(tmp_path / "in", tmp_path / "out")


def test_an_export_of_a_folder_says_its_format_and_writes_as_alone(folder: Path, tmp_path: Path):
    given = {"input": str(folder), "output": tmp_path / "out", "jobs": 1}
    for wrong in ({}, {"format": "csv", "suffix": ".glb"}, {"suffix": ".txt"}):
        with pytest.raises(UsageError):
            export(ExportConfig.model_validate({**given, **wrong}))
    assert not (tmp_path / "out").exists()
    figures = export(ExportConfig.model_validate({**given, "format": "amass"})).figures
    assert (figures["written"], figures["failed"]) == (3, 1) and rows_of(tmp_path / "out")["kick.bvh"][
        "frames"
    ] == "46"
    export(ExportConfig(input=str(CLIPS / "punch.bvh"), output=tmp_path / "alone.npz"))
    assert (tmp_path / "out/inner/punch.npz").read_bytes() == (tmp_path / "alone.npz").read_bytes()
    assert export(ExportConfig.model_validate({**given, "format": "amass"})).figures["kept"] == 3
