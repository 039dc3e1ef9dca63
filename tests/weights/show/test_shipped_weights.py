"""Which weights there are, which serve by default, and what is told of them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from data_schemas.errors import InputError
from data_schemas.manifest import open_artefact
from stages.infill.config import Config as InfillConfig
from stages.shared.weights import shipped
from stages.shared.weights.facts import facts_of, verdicts
from stages.shared.weights.shipped import default_weights, shipped_weights
from stages.shared.weights.task_weights import shipped_task_weights
from stages.weights.list.config import Config as ListConfig
from stages.weights.list.run import run as list_weights
from stages.weights.show.config import Config as ShowConfig
from stages.weights.show.run import run as show_weights
from tests.shared.inference.examples import write_random_weights


@pytest.fixture
def shelf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of shipped weights that holds `small` alone."""
    write_random_weights(tmp_path / "small")
    monkeypatch.setattr(shipped, "SHIPPED", tmp_path)
    return tmp_path


def test_the_default_is_the_first_of_the_preferred_that_is_shipped(shelf: Path) -> None:
    def infill() -> str:
        return InfillConfig(input=Path("a.bvh"), output=Path("b.bvh")).weights

    assert shipped_weights() == ["small"] and default_weights() == infill() == "small"
    shutil.copytree(shelf / "small", shelf / "small-free")
    assert infill() == ShowConfig().name == "small-free"
    assert InfillConfig(input=Path("a.bvh"), output=Path("b.bvh"), weights="small").weights == "small"


def test_the_list_marks_the_default_and_names_licences(shelf: Path) -> None:
    report = list_weights(ListConfig())
    text = "\n".join(report.lines)
    assert "small" in text and "(default)" in text and report.figures["weights"]["small"]["default"] is True
    assert set(report.figures["weights"]["small"]["parameters"]) == {"autoencoder", "synthesiser"}
    shutil.rmtree(shelf / "small")
    assert list_weights(ListConfig()).lines == ["No weights are shipped or fetched."]


def test_what_was_measured_is_told_by_its_intervals(shelf: Path) -> None:
    def row(scope: str, task: str, ratio: float, low: float | None, high: float | None) -> dict:
        return {
            "scope": scope, "task": task, "interval": 15, "baseline": "slerp", "ratio": ratio, "low": low,
            "high": high, "windows": 9,
        }  # fmt: skip

    rows = [
        row("all archives", "interpolation", 0.8, 0.7, 0.9),
        row("all archives", "transition", 1.0, 0.9, 1.1),
        row("all archives", "prediction", 1.4, 1.2, 1.6),
        row("robots", "transition", 2.0, 1.8, 2.2),
    ]
    found = verdicts(rows)
    assert [len(found[kind]) for kind in ("better", "alike", "worse")] == [1, 1, 1]
    (shelf / "small" / "measured.json").write_text(json.dumps(rows))
    text = "\n".join(show_weights(ShowConfig(name="small")).lines)
    assert "Good at: interpolation 15 (0.80)" in text and "Bad at: prediction 15 (1.40)" in text
    assert "Worst of all: transition 15 on robots (2.00)" in text
    (shelf / "small" / "measured.json").write_text('[{"scope": 1}]')
    with pytest.raises(InputError, match=r"measured\.json"):
        facts_of("small")


def test_digests_tell_which_weights_of_a_name_they_are(shelf: Path) -> None:
    digests = {
        part: open_artefact(shelf / "small" / name, "checkpoint").manifest.digest
        for part, name in (("autoencoder", "ae"), ("synthesiser", "lms"))
    }
    report = show_weights(ShowConfig(name="small"))
    assert report.figures["digests"] == digests
    assert "Digests: " + ", ".join(f"{part} {each[:12]}" for part, each in digests.items()) + "." in report.lines


def test_the_digest_of_a_network_for_one_task_is_told() -> None:
    if "lifter" not in shipped_task_weights():
        pytest.skip("no lifter is shipped")
    digest = open_artefact(shipped.SHIPPED / "lifter", "checkpoint").manifest.digest
    report = show_weights(ShowConfig(name="lifter"))
    (told,) = (line for line in report.lines if line.startswith("Digests: "))
    assert told.endswith(f" {digest[:12]}.") and [*report.figures["digests"].values()] == [digest]


def test_unknown_weights_are_refused_by_name(shelf: Path) -> None:
    with pytest.raises(InputError, match=r"neither .* nor shipped \(small\), nor fetched"):
        show_weights(ShowConfig(name="huge"))
