"""The notebooks run from their first cell to their last, and show what such a run prints and draws."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from tests.docs.pages import ROOT

pytest.importorskip("nbclient", reason="what runs notebooks needs Python 3.11")
pytest.importorskip("ipykernel", reason="what runs notebooks needs Python 3.11")

from docs.notebooks.run import HERE, executed

NOTEBOOKS = sorted(HERE.glob("*.ipynb"))
MOST_BYTES = 150_000
_NUMBER = re.compile(r"\d+(?:\.\d+)?")


def shown(notebook: Any) -> list[list[tuple[str, str]]]:
    """Of each code cell: kind and text of what it printed, returned and drew."""
    cells = []
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            texts = [("text", _joined(each["text"])) for each in cell["outputs"] if "text" in each]
            kinds = [(kind, "") for each in cell["outputs"] for kind in sorted(each.get("data", {}))]
            cells.append([*texts, *kinds])
    return cells


def _joined(text: str | list[str]) -> str:
    return "".join(text)


def read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_shows_what_its_run_shows(path: Path, monkeypatch: pytest.MonkeyPatch):
    """Numbers may differ a little between machines."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    now, kept = shown(executed(path)), shown(read(path))
    assert any(cell for cell in kept)
    for number, (cell, other) in enumerate(zip(now, kept, strict=True)):
        assert [kind for kind, _ in cell] == [kind for kind, _ in other], f"code cell {number}"
        for (_, text), (_, before) in zip(cell, other, strict=True):
            assert _NUMBER.sub("#", text) == _NUMBER.sub("#", before)
            values, known = ([float(each) for each in _NUMBER.findall(each)] for each in (text, before))
            assert values == pytest.approx(known, rel=0.1, abs=1e-2)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_small_and_says_nothing_of_its_machine(path: Path):
    assert path.stat().st_size < MOST_BYTES
    notebook = read(path)
    assert set(notebook["metadata"]) == {"kernelspec", "language_info"}
    assert not [cell for cell in notebook["cells"] if cell["metadata"]]
    counts = [cell["execution_count"] for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert counts == [*range(1, len(counts) + 1)]
    assert not [
        each for cell in notebook["cells"] for each in cell.get("outputs", []) if each.get("name") == "stderr"
    ]
