"""The README's animation: three rigs from embedded clips alone, a column for each of the weights, under 2 MB."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree

import pytest

from data_schemas.errors import PumpsError
from stages.shared.weights.shipped import default_weights
from tests.pipeline.benchmark_scripts import benchmark_script
from tests.report.pages import parsed
from tests.shared.inference.examples import write_random_weights

SHOWN = Path(__file__).resolve().parents[2] / "docs" / "pictures" / "first-animation.svg"


@pytest.fixture(scope="module")
def made() -> ModuleType:
    return benchmark_script("first_animation")


def test_each_rig_is_filled_by_each_of_the_weights(
    made: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    weights = write_random_weights(tmp_path / "adapted")
    drawn = tmp_path / "drawn.svg"
    made.animate(made.ROWS, tmp_path / "out", [str(weights)], drawn)
    _, scenes, _ = parsed(tmp_path / "out" / "page.html")
    assert [[motion["name"] for motion in scene["motions"]] for scene in scenes] == [
        ["truth", "slerp", "adapted"]
    ] * 3
    assert len({scene["motions"][0]["nodes"] for scene in scenes}) == 3  # three rigs
    assert "adapted: " in "".join(ElementTree.parse(drawn).getroot().itertext())
    monkeypatch.setattr(made, "MOST_BYTES", 1000)
    with pytest.raises(PumpsError, match="bytes"):
        made.animate(made.ROWS[:1], tmp_path / "out", [], drawn)


def test_the_one_in_the_readme_is_of_the_default_weights_on_all_rigs(made: ModuleType) -> None:
    assert SHOWN.stat().st_size < made.MOST_BYTES
    texts = "".join(ElementTree.parse(SHOWN).getroot().itertext())
    assert texts.count(f"{default_weights()}: ") == len(made.ROWS) == 3
    assert all(row.title in texts and row.rig in texts for row in made.ROWS)
