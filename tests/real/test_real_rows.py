"""Rows of real BVHs: the fast parser gives the careful parser's bits. All of them: benchmarks/same_numbers.py."""

from __future__ import annotations

from pathlib import Path

import pytest

from stages.shared.formats import number_rows
from stages.shared.formats.sources import find_sources
from tests.pipeline.benchmark_scripts import benchmark_script

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
pytestmark = [
    pytest.mark.real,
    pytest.mark.skipif(not (DATA / "cmu-dance.zip").exists(), reason="no recordings beside the project"),
]


@pytest.mark.parametrize("archive", ["bandai-namco-1", "cmu-dance", "cmu-various", "lafan1-g1", "reactidle"])
def test_the_bits_of_real_rows_are_those_of_the_careful_parser(archive: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(number_rows, "WORTH_BYTES", 0)  # short files too
    sources = sorted(find_sources([str(DATA / f"{archive}.zip")]), key=lambda source: source.size)
    numbers, fast, left = benchmark_script("same_numbers").compare(sources[:: max(1, len(sources) // 3)][:3])
    assert numbers > 10_000 and fast == 3 and left == 0
