"""Colours: on a terminal alone, never in JSON, and none where NO_COLOR is set."""

from __future__ import annotations

import io
import sys

import pytest

from pumps_cli.outcome import TINTS, Manner, show_report
from stages.shared.contract import StageReport

REPORT = StageReport(lines=["  Hips [x]", "plain"], tints={0: "left_arm"})


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def _shown(monkeypatch: pytest.MonkeyPatch, manner: Manner, out: io.StringIO) -> str:
    monkeypatch.setattr(sys, "stdout", out)
    show_report(manner, REPORT)
    return out.getvalue()


def test_lines_are_tinted_on_a_terminal_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.delenv("NO_COLOR", raising=False)
    shown = _shown(monkeypatch, Manner(), _Terminal())
    assert "\x1b[32m  Hips [x]\x1b[0m\n" in shown and "\nplain\n" in shown
    assert _shown(monkeypatch, Manner(), io.StringIO()) == "  Hips [x]\nplain\n"
    assert "\x1b" not in _shown(monkeypatch, Manner(json=True), _Terminal())
    assert _shown(monkeypatch, Manner(quiet=True), _Terminal()) == ""
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b[32" not in _shown(monkeypatch, Manner(), _Terminal())
    assert set(TINTS) >= {"spine", "left_arm", "right_arm", "left_leg", "right_leg", "faint", "problem"}
