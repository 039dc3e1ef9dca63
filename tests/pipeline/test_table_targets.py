"""`make table2` and `make latent-report` as DAGs: every row is made once, and made again when its settings change."""

from __future__ import annotations

from pathlib import Path

import pytest

from stages.measure.ae.methods import PAPER
from tests.pipeline.test_makefile import ROOT, Run


class Table(Run):
    """The same, of another target."""

    target = "table2-rows"


@pytest.fixture
def table(tmp_path: Path) -> Run:
    return Table(tmp_path)


def rows_of_the_makefile() -> list[str]:
    line = next(x for x in (ROOT / "Makefile").read_text().splitlines() if x.startswith("TABLE2_ROWS :="))
    return line.partition(":=")[2].split()


def test_the_table_has_the_papers_rows_and_ours():
    assert len(rows_of_the_makefile()) == len(PAPER) + 1


def test_every_row_is_trained_once_and_all_are_measured_together(table: Run):
    ran = table.make()
    assert ran[:2] == ["ingest", "sample-tpc"] and ran[-1] == "measure-ae"
    assert ran.count("train-ae") == len(rows_of_the_makefile()) == len(ran) - 3
    assert table.make() == []
    assert set(table.make("train-ae.steps=9")) == {"train-ae", "measure-ae"}


def test_a_table_that_was_cut_off_goes_on_where_it_was(table: Run):
    table.make(fail="measure-ae", code=2)
    assert table.make() == ["measure-ae"]


def test_weights_are_measured_on_archives_that_they_never_saw(tmp_path: Path):
    report = Table(tmp_path)
    report.target = "held-out-measured"
    assert report.make() == ["ingest", "evaluate"]
    assert report.make() == []
    assert report.make(flags=("HELD_OUT_WEIGHTS=tiny another",)) == ["evaluate"]


def test_weights_are_measured_on_rigs_that_they_never_saw(tmp_path: Path):
    report = Table(tmp_path)
    report.target = "unseen-rigs-measured"
    assert report.make() == ["ingest", "ingest", "data-rerig", "evaluate"]
    assert report.make() == []
    assert report.make(flags=("HELD_OUT_WEIGHTS=tiny another",)) == ["evaluate"]


def test_shipped_weights_are_measured_once_for_all_tables_about_them(tmp_path: Path):
    report = Table(tmp_path)
    report.target = "weights-measured"
    assert report.make() == ["ingest", *["evaluate"] * 5, "ingest", "data-rerig", "evaluate"]
    assert report.make() == []


def test_the_latent_report_needs_recordings_alone(tmp_path: Path):
    report = Table(tmp_path)
    report.target = "latents"
    assert report.make() == ["ingest", "measure-latents"]
    assert report.make() == []
