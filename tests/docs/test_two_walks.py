"""The page's walk of a file through `infill` is the walk that the code takes."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
STEPS = (
    "infill/run", "shared/inference/filling", "shared/inference/cloud_sources", "shared/solve/solving",
    "shared/inference/easing", "shared/inference/foot_lock", "shared/inference/filled",
)  # fmt: skip


def test_infill_enters_no_more_rooms_than_the_page_says_and_in_its_order():
    command = [sys.executable, "benchmarks/rooms.py", "infill", "--json"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    told = subprocess.run(command, cwd=ROOT, env=environment, check=True, capture_output=True, text=True)
    walk = json.loads(told.stdout)["infill"]
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    row = re.search(r"^\| a BVH through `infill` \| \d+ \| (\d+) \| \d+ \| (\d+) \|", page, re.MULTILINE)
    assert row is not None
    assert len(walk["rooms"]) <= int(row[1]) and len(walk["climbs"]) <= int(row[2])
    assert [room for room in walk["rooms"] if room in STEPS] == list(STEPS)
