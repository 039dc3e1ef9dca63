"""Other versions of this project, to measure beside the one at hand."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

HERE = Path(__file__).resolve().parents[2]


@contextmanager
def checked_out(commit: str) -> Iterator[Path]:
    """A folder with the files of a commit of this repository, removed at the end.

    Raises: SystemExit if there is no such commit.
    """
    with tempfile.TemporaryDirectory() as folder:
        base = Path(folder).resolve() / "base"
        git = ["git", "-C", str(HERE), "worktree"]
        if not commit or subprocess.run([*git, "add", "--quiet", "--detach", str(base), commit]).returncode:
            raise SystemExit(f"{commit!r} is no commit of this repository; give one, as in BASE=HEAD~1.")
        try:
            yield base
        finally:
            subprocess.run([*git, "remove", "--force", str(base)])
