"""What `pumps ingest` loads before it reads: each of its processes loads it again."""

from __future__ import annotations

import subprocess
import sys

HEAVY = ("torch", "scipy.signal", "scipy.stats", "scipy.optimize")


def test_ingest_starts_without_libraries_that_take_longer_than_reading() -> None:
    ask = f"import sys, stages.ingest.run; print([each for each in {HEAVY} if each in sys.modules])"
    found = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
