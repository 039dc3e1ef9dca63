"""What holds for all tests: the command run in this process, Python processes that share their imports, no browser
that opens, and at the end how many damaged files the readers were given."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import pytest

from tests.forked_processes import forked_python

os.environ["BROWSER"] = "true"  # commands that open a page start this program of no effect


@dataclass(frozen=True)
class Ran:
    """What a command left behind."""

    code: int
    out: str
    err: str


@pytest.fixture
def pumps(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Ran]:
    """`pumps("train", "ae", ...)` runs it and gives exit code, stdout and stderr."""
    from pumps_cli.app import main  # most tests run no command

    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("TERM", "dumb")

    def run(*words: object) -> Ran:
        capsys.readouterr()
        with pytest.raises(SystemExit) as leaving:
            main([str(word) for word in words])
        shown = capsys.readouterr()
        return Ran(int(leaving.value.code or 0), shown.out, shown.err)

    return run


@pytest.fixture(scope="session")
def fast_python(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, ...]]:
    """The words of a command that stands for `python` and need not import torch and pumps."""
    with forked_python(tmp_path_factory.mktemp("python"), "everything") as words:
        yield words


@pytest.fixture(scope="session")
def light_python(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, ...]]:
    """The same, for programs that need no torch: the settings of stages are imported."""
    with forked_python(tmp_path_factory.mktemp("python"), "settings") as words:
        yield words


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
