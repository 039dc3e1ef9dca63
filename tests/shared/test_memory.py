"""Freed memory is used again: the system does not clear the same pages for every large array."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
# Blocks of 4 and 8 MiB, made and freed one after another; then how many pages the system gave out for the last ones.
ARRAYS = """
import resource, sys
import pumps_cli.app
try: pumps_cli.app.main(["stages"])
except SystemExit: pass
def make(count):
    for _ in range(count): len(b"1" * 2**22 + b"1" * 2**22)
make(3)
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
make(20)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before, file=sys.stderr)
"""


def pages_of_arrays(**environment: str) -> int:
    kept = {name: value for name, value in os.environ.items() if not name.startswith("MALLOC_")}
    told = subprocess.run(
        [sys.executable, "-c", ARRAYS],
        capture_output=True, text=True, check=True, cwd=ROOT, env=kept | environment,
    ).stderr  # fmt: skip
    return int(told.split()[-1])


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems have another allocator")
def test_freed_memory_is_used_again_unless_the_environment_says_otherwise():
    asked_otherwise = pages_of_arrays(MALLOC_MMAP_THRESHOLD_="131072")
    if asked_otherwise < 20 * 1024:
        pytest.skip("this C library has other settings than glibc's")
    assert pages_of_arrays() < asked_otherwise / 20
