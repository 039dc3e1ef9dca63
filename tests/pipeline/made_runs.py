"""Runs of the makefile in a folder of their own, with stages that only leave targets."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


class Run:
    """`make fill` in a folder of its own, on a data folder of its own, with stages that only leave targets.

    python: the words of the command that runs `fake_pumps.py`.
    """

    target = "fill"

    def __init__(self, folder: Path, python: Sequence[str]):
        self.python = python
        self.data = folder / "data"
        self.data.mkdir()
        for name in ("a", "b"):
            (self.data / f"{name}.bvh").write_text(f"HIERARCHY {name}")
        (self.data / "splits.json").write_text("{}")
        self.runs = folder / "runs"
        self.log = folder / "log"

    def make(self, *settings: str, fail: str = "", flags: Sequence[str] = (), code: int = 0) -> list[str]:
        """Run it and give the stages that ran, in order."""
        self.log.write_text("")
        fake = f"{' '.join(self.python)} {Path(__file__).parent / 'fake_pumps.py'}"
        command = [
            "make", self.target,
            f"PUMPS={fake}", f"RUNS={self.runs}", "RUN=it", f"DATA={self.data}", "PRESET=tiny",
            f"SET={' '.join(settings)}", *flags,
        ]  # fmt: skip
        kept = {key: value for key, value in os.environ.items() if not key.startswith(("MAKE", "MFLAGS"))}
        done = subprocess.run(
            command, cwd=ROOT, env={**kept, "LOG": str(self.log), "FAIL": fail}, capture_output=True, text=True
        )
        self.said = done.stdout + done.stderr
        assert done.returncode == code, self.said
        return self.log.read_text().split()
