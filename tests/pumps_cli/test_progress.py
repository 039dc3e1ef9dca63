"""Progress is seen on a terminal and nowhere else."""

from __future__ import annotations

import os
import pty
import subprocess
import sys

CODE = """
from pumps_cli.progress import TerminalProgress
with TerminalProgress(quiet={quiet}) as progress:
    progress.start("Counting", 3)
    for number in range(3):
        progress.advance(1, f"at [{{number}}]")
    progress.message("a [warning]")
    progress.start("Without a total")
    progress.advance()
"""


def run(quiet: bool, *, terminal: bool) -> str:
    """What the snippet writes to stderr."""
    command = [sys.executable, "-c", CODE.format(quiet=quiet)]
    if not terminal:
        return subprocess.run(command, capture_output=True, text=True, check=True).stderr
    ours, theirs = pty.openpty()
    with subprocess.Popen(command, stderr=theirs, env={**os.environ, "TERM": "xterm"}) as process:
        os.close(theirs)
        seen = b""
        while True:
            try:
                part = os.read(ours, 65536)
            except OSError:  # the other end is closed
                break
            if not part:
                break
            seen += part
    assert process.returncode == 0
    return seen.decode()


def test_a_terminal_shows_a_bar_and_the_message():
    seen = run(False, terminal=True)
    assert "Counting" in seen and "/3" in seen and "a [warning]" in seen


def test_elsewhere_only_messages_are_written():
    assert run(False, terminal=False) == "a [warning]\n"


def test_quiet_writes_nothing():
    assert run(True, terminal=False) == ""
