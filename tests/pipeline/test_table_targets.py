"""Recipes of tables as DAGs: every node is made once, and again when its settings change; what is missing is told."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from zipfile import ZipFile

import pytest

from stages.measure.ae.methods import PAPER
from stages.shared.settings.recipes import read_recipe, recipe_names
from stages.shared.weights.shipped import shipped_weights
from stages.shared.weights.task_weights import shipped_task_weights
from tests.pipeline.made_runs import ROOT, Run

RECIPE_OF = {
    "table1": "table1", "figures": "table1", "table2": "table2", "table3": "table3",
    "table4": "table4", "table-trackers": "trackers",
    "pcmrl-table1": "pcmrl", "pcmrl-table2": "pcmrl", "pcmrl-table3": "pcmrl",
    "rig-report": "pcmrl",
    "body-parts-table1": "body-parts", "body-parts-table2": "body-parts", "body-parts-table3": "body-parts",
    "latent-report": "latents", "solve-report": "solve", "solve-pages": "solve", "held-out": "held-out",
    "unseen-rigs": "unseen-rigs", "weights-report": "weights", "pretrain": "small", "lifter": "lifter",
    "spectral-tables": "spectral", "spectral-pages": "spectral", "concepts-tables": "concepts",
}  # fmt: skip

MEMBERS = {"cmu-various": ["cmu-various/06/06_01.bvh"]}  # which recipes name: the rig of the lifter


class Table(Run):
    """The same, of another target, whose installation counts as done."""

    def __init__(self, folder: Path, target: str, python: Sequence[str]):
        super().__init__(folder, python)
        self.target = target
        self.venv = folder / "venv"
        (self.venv / "bin").mkdir(parents=True)
        for name in ("bin/python", "installed", "installed-dev", "installed-mesh"):
            (self.venv / name).write_text("#!/bin/sh\n")
            (self.venv / name).chmod(0o755)

    def make(self, *settings: str, flags: tuple[str, ...] = (), **more) -> list[str]:
        return super().make(*settings, flags=(f"VENV={self.venv}", "PRESET=", *flags), **more)


@pytest.fixture
def table_of(tmp_path: Path, light_python: tuple[str, ...]) -> Callable[[str], Table]:
    """The table of a target, in the test's folder."""
    return lambda target: Table(tmp_path, target, light_python)


@pytest.fixture
def table(table_of: Callable[[str], Table]) -> Table:
    return table_of("table2")


ROWS = [name for name in read_recipe("table2").nodes if name.startswith("rows/")]


def test_the_table_has_the_papers_rows_and_ours():
    assert len(ROWS) == len(PAPER) + 1


@pytest.mark.parametrize("name", recipe_names())
def test_settings_hold_no_names_that_stand_for_words(name: str):
    for node in read_recipe(name, data_folder="data").nodes.values():
        assert not re.search(r"\{[a-z-]+\}", repr(node.settings)), node.name


@pytest.mark.parametrize("name", recipe_names())
def test_weights_that_a_recipe_names_are_shipped(name: str):
    recipe = read_recipe(name, data_folder="data")
    shipped = {*shipped_weights(), *shipped_task_weights()}
    for node in recipe.nodes.values():
        for field, place in node.inputs:
            source = place.rpartition("=")[2]
            made = source.startswith(".") or any(f"{source}/".startswith(f"{each}/") for each in recipe.nodes)
            assert field != "weights" or made or source in shipped, (node.name, place)


def test_every_row_is_trained_once_and_all_are_measured_together(table: Table):
    ran = table.make()
    assert ran[:2] == ["ingest", "sample-tpc"] and ran[-1] == "measure-ae"
    assert ran.count("train-ae") == len(ROWS) == len(ran) - 3
    assert table.make() == []
    assert set(table.make("train-ae.steps=9")) == {"train-ae", "measure-ae"}
    assert table.make("train-ae.steps=9", "rows/chamfer.steps=8") == ["train-ae", "measure-ae"]


def test_table_1_trains_and_measures_every_method_by_itself(tmp_path: Path, table_of: Callable[[str], Table]):
    table = table_of("table1")
    names = list(read_recipe("table1", data_folder="data").nodes)
    shared = tmp_path / "shared"
    shared.mkdir()
    for archive in read_recipe("table1").data.archives:
        with ZipFile(shared / f"{archive}.zip", "w") as zipped:
            zipped.writestr("a.bvh", "HIERARCHY")
    flags = (f"SHARED_DATA={shared}", "DATA=", "GOAL=g1")
    ran = table.make(flags=flags)
    assert len(ran) == sum(name.startswith("g1/") and name != "g1/figures" for name in names)
    assert ran[-1] == "measure-table1"
    assert ran.count("train-baseline") == 6 and ran.count("evaluate") == 10
    again = table.make("g1/trained/delta.seed=3", flags=flags)
    assert again == ["train-baseline", "evaluate", "measure-table1"]
    table.target = "figures"  # of the same run: nothing is measured again
    assert table.make("g1/trained/delta.seed=3", flags=flags) == ["report"]


def test_a_table_that_was_cut_off_goes_on_where_it_was(table: Table):
    table.make(fail="measure-ae", code=2)
    assert table.make() == ["measure-ae"]


def test_weights_are_measured_on_archives_that_they_never_saw(table_of: Callable[[str], Table]):
    report = table_of("held-out")
    assert report.make() == ["ingest", "evaluate"]
    assert report.make() == []
    assert report.make(flags=("HELD_OUT_WEIGHTS=small-free another",)) == ["evaluate"]


def test_weights_are_measured_on_rigs_that_they_never_saw(table_of: Callable[[str], Table]):
    report = table_of("unseen-rigs")
    assert sorted(report.make()) == ["data-rerig", "evaluate", "ingest", "ingest"]
    assert report.make() == []
    assert report.make(flags=("HELD_OUT_WEIGHTS=small",)) == ["evaluate"]


def test_shipped_weights_are_measured_once_for_all_tables_about_them(table_of: Callable[[str], Table]):
    report = table_of("weights-report")
    assert sorted(report.make()) == ["data-rerig", *["evaluate"] * 6, "ingest", "ingest"]
    assert report.make() == []


def test_the_latent_report_needs_recordings_alone(table_of: Callable[[str], Table]):
    report = table_of("latent-report")
    assert report.make() == ["ingest", "measure-latents"]
    assert report.make() == []


def test_solve_pages_play_what_was_made_for_each_rig_truth_first(table_of: Callable[[str], Table]):
    pages = table_of("solve-pages")
    assert pages.make() == ["ingest", "measure-solve", "report"]
    assert (pages.runs / "it" / "solve.html").exists() and pages.make() == []


def _archives(folder: Path, names: list[str]) -> None:
    folder.mkdir()
    for name in names:
        with ZipFile(folder / f"{name}.zip", "w") as archive:
            archive.writestr(f"{name}/a.bvh", "HIERARCHY")
            for member in MEMBERS.get(name, ()):
                archive.writestr(member, "HIERARCHY")


@pytest.mark.parametrize("target", RECIPE_OF)
def test_every_recipe_runs_to_its_end_on_archives_of_its_names_and_then_no_more(
    tmp_path: Path, table_of: Callable[[str], Table], target: str
):
    table = table_of(target)
    recipe = read_recipe(RECIPE_OF[target])
    _archives(tmp_path / "shared", list(recipe.data.archives))
    flags = (f"SHARED_DATA={tmp_path / 'shared'}", "DATA=", "ROUNDS=3", "CALIBRATE=stages/shared/clips")
    ran = table.make(flags=flags)
    assert len(ran) >= 2 and ran[0] == "ingest"
    assert table.make(flags=flags) == []


@pytest.mark.parametrize("target", RECIPE_OF)
def test_a_table_without_its_archives_says_which_and_where_they_come_from(
    tmp_path: Path, table_of: Callable[[str], Table], target: str
):
    table = table_of(target)
    recipe = read_recipe(RECIPE_OF[target])
    flags = (f"SHARED_DATA={tmp_path / 'nowhere'}", "DATA=")
    if recipe.data.embedded and recipe.data.missing == "left-out":
        assert table.make(flags=flags)[0] == "ingest", "the clips that come with pumps are there"
        return
    assert table.make(flags=flags, code=2) == []
    g1 = ("lafan1-g1.zip", "forward kinematics")
    bandai = ("bandai-namco-1.zip", "data fetch bandai-namco-1")
    origins = {"table1": g1, "figures": g1, "table3": g1, "table4": bandai, "table-trackers": bandai}
    origins |= {f"body-parts-table{number}": ("hdm05.zip", "cut clips") for number in (1, 2, 3)}
    origins["concepts-tables"] = ("hdm05.zip", "cut clips")
    named, origin = origins.get(target, ("cmu-dance.zip", "cgspeed"))
    assert named in table.said and origin in table.said.lower() and "nowhere" in table.said


def test_archives_of_weights_that_ship_are_free_or_at_least_may_be_trained_on():
    free, non_commercial = (set(read_recipe(name).data.archives) for name in ("small-free", "small"))
    assert non_commercial - free == {"bandai-namco-1", "bandai-namco-2"}
    never = {"lafan1-g1", "hdm05"}
    assert not non_commercial & never and never <= set(read_recipe("held-out").data.archives)
    for name in ("train-ae", "train-lms"):
        assert read_recipe("small").nodes[name].settings["balance"] == 0.5


def test_rounds_begin_with_the_mean_of_the_last_ones_end_and_beginning():
    recipe = read_recipe("small", ["rounds=3", "initial=weights/mine"])
    places = {name: [place for _, place in node.inputs] for name, node in recipe.nodes.items()}
    assert places["round-2/begin"] == ["train-lms", "weights/mine/lms"]
    assert places["round-3/begin"] == ["round-2/train-lms", "round-2/begin"]
    assert places["averaged/train-lms"] == ["round-3/train-lms", "round-3/begin"]
    assert places["packed/small"] == ["./averaged"]
    assert recipe.nodes["round-3/train-lms"].settings["seed"] == 3
    once = read_recipe("small", ["rounds=0"])
    assert "averaged/train-lms" not in once.nodes and once.nodes["calibrate"].inputs[-1] == ("motion", "ingest")
    assert once.nodes["packed/small"].inputs == (("run", "."),)


def test_every_recipe_is_read_and_its_makefile_stands_alone(table_of: Callable[[str], Table]):
    assert {*RECIPE_OF.values(), "small-free"} == set(recipe_names())
    table = table_of("table2")
    table.make(fail="ingest", code=2)
    makefile = table.runs / "it" / "run.mk"
    shown = subprocess.run(["make", "-n", "-f", makefile], cwd=ROOT, capture_output=True, text=True, check=True)
    assert "pumps measure ae" in shown.stdout and json.dumps(str(table.runs)).strip('"') in shown.stdout
