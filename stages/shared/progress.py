"""How a stage reports progress without a terminal."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Passed into every stage as `progress`; the command line hands in a Rich bar, tests and libraries `SILENT`."""

    def start(self, label: str, total: float | None = None) -> None:
        """Begin (or replace) the current bar: `label` says what is being done, `total` how many steps, if known."""

    def advance(self, steps: float = 1, note: str = "") -> None:
        """Move the bar; `note` is a short text beside it (a loss, a file name)."""

    def message(self, text: str) -> None:
        """A line for the user that stays (a warning, a result)."""


class _Silent:
    def start(self, label: str, total: float | None = None) -> None: ...

    def advance(self, steps: float = 1, note: str = "") -> None: ...

    def message(self, text: str) -> None: ...


SILENT: Progress = _Silent()
