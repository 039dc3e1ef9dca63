"""The page of the weights that ship: every table on it is written by what `make weights-report` measures."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from data_schemas.artefact import write_artefact
from data_schemas.metrics import MetricRow, write_metrics
from stages.shared.settings.recipes import read_recipe
from tests.pipeline.benchmark_scripts import benchmark_script

ROW = MetricRow("c", "s", "set-1", "slerp", "interpolation", 15, "l2p_m", 0.5)

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "results.md"
SECTION = re.compile(r"<!-- weights (.+): begin -->(.*?)<!-- weights \1: end -->", re.S)


@pytest.fixture(scope="module")
def made() -> ModuleType:
    return benchmark_script("weights_tables")


def test_every_table_has_its_place_on_the_page_and_its_node_in_the_recipe(made: ModuleType) -> None:
    marked = [name for name, _ in SECTION.findall(PAGE.read_text("utf-8"))]
    assert sorted(marked) == sorted(["summary", *made.TABLES])
    assert set(read_recipe("weights").goals["run"].nodes) == {folder for folder, _ in made.TABLES.values()}


def written_by(made: ModuleType, run: Path, rows: list[MetricRow], code: str, only: str = "") -> None:
    """Evaluations of every node of the page (or of `only`), as that code would write them."""
    weights = [{"name": "small", "source": "small", "digests": {"ae": "a" * 64, "lms": "b" * 64}}]
    for folder in {only} if only else {folder for folder, _ in made.TABLES.values()}:
        with write_artefact(run / folder, "metrics", stage="evaluate", config={}) as draft:
            draft.summary |= {"code": code, "weights": weights}
            write_metrics(draft.folder, rows, "# Evaluation")


def test_tables_of_different_code_are_refused(made: ModuleType, tmp_path: Path, monkeypatch) -> None:
    rows = [ROW, replace(ROW, method="small", value=0.25)]
    written_by(made, tmp_path, rows, "c0de" * 16)
    written_by(made, tmp_path, rows, "beef" * 16, only="own-small")
    monkeypatch.setattr(sys, "argv", ["weights_tables.py", str(tmp_path)])
    with pytest.raises(SystemExit, match="different code"):
        made.main()


def test_what_was_measured_stands_on_the_page(made: ModuleType, tmp_path: Path, monkeypatch) -> None:
    filled = replace(ROW, method="small", value=0.25)
    measured = [ROW, filled, replace(filled, metric="key_jump_mps", value=0.98765)]
    written_by(made, tmp_path, measured, "c0de" * 16)
    page = tmp_path / "page.md"
    page.write_text(PAGE.read_text("utf-8"), "utf-8")
    monkeypatch.setattr(sys, "argv", ["weights_tables.py", str(tmp_path), "--page", str(page)])
    made.main()
    text, before = page.read_text("utf-8"), PAGE.read_text("utf-8")
    written = "".join(section[1] for section in SECTION.findall(text))
    assert written.count("| set-1 | small | 0.50") == 4, "shares of slerp's 0.5"
    assert "| `small` | test clips of its recipe's archives |  | 0.50 |" in written
    assert "`c0dec0dec0dec0de`" in written and "- `small`: ae `aaaaaaaaaaaaaaaa`, lms `bbbbbbbbbbbbbbbb`" in written
    assert written.count("×0.50") == 5 and written.count("0.988") == 2
    assert SECTION.sub("", text) == SECTION.sub("", before), "nothing else is touched"
