"""What holds for all tests: no browser opens, and the end tells how many damaged files readers were given."""

from __future__ import annotations

import os
from collections import Counter

import pytest

os.environ["BROWSER"] = "true"  # commands that open a page start this program of no effect


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """One line a reader: files that were damaged on purpose, and how many of them could be read all the same."""
    given: Counter[str] = Counter()
    read: Counter[str] = Counter()
    for reports in terminalreporter.stats.values():
        for report in reports:
            for key, value in getattr(report, "user_properties", ()):
                if key == "damaged_files" and getattr(report, "when", "") == "call":
                    kind, files, sound = str(value).split()
                    given[kind] += int(files)
                    read[kind] += int(sound)
    if given:
        terminalreporter.section("damaged files given to readers", sep="-")
        for kind, files in given.items():
            terminalreporter.write_line(f"{kind}: {files} ({read[kind]} were still read, the others refused)")
