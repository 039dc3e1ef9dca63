"""Progress on a terminal: a Rich bar with rate and time left; silent elsewhere."""

from __future__ import annotations

import sys
from types import TracebackType
from typing import TYPE_CHECKING

from pumps_cli.terminal import say_aside, visible

if TYPE_CHECKING:
    from rich.progress import Progress as RichBars


class TerminalProgress:
    """A stage's `Progress`. Bars live on stderr, only on a terminal; messages are lines on stderr anywhere.

    Use it as a context manager: leaving it takes the bar away.
    """

    def __init__(self, *, quiet: bool = False):
        self._quiet = quiet
        self._bars: RichBars | None = None
        self._task: int | None = None

    def __enter__(self) -> TerminalProgress:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None):
        if self._bars is not None:
            self._bars.stop()
            self._bars = None

    def start(self, label: str, total: float | None = None) -> None:
        """Begin, or replace, the bar."""
        if self._quiet or not sys.stderr.isatty():
            return
        if self._bars is None:
            self._bars = _bars()
            self._bars.start()
        elif self._task is not None:
            self._bars.remove_task(self._task)  # type: ignore[arg-type]
        self._task = self._bars.add_task(visible(label, one_line=True), total=total, note="")

    def advance(self, steps: float = 1, note: str = "") -> None:
        """Move the bar."""
        if self._bars is not None and self._task is not None:
            self._bars.update(self._task, advance=steps, note=visible(note, one_line=True))  # type: ignore[arg-type]

    def message(self, text: str) -> None:
        """A line that stays; it does not tear the bar."""
        if self._quiet:
            return
        if self._bars is not None:
            self._bars.console.print(visible(text), markup=False, highlight=False)
        else:
            say_aside(text)


def _bars() -> RichBars:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn, TimeRemainingColumn
    from rich.text import Text

    class Rate(ProgressColumn):
        """Steps per second, or seconds per step where that is the larger number."""

        def render(self, task) -> Text:  # type: ignore[no-untyped-def]
            speed = task.speed or 0
            if not speed:
                return Text("")
            return Text(f"{speed:.1f}/s" if speed >= 1 else f"{1 / speed:.1f} s each")

    return Progress(
        TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), Rate(),
        TimeRemainingColumn(), TextColumn("{task.fields[note]}", markup=False),
        console=Console(stderr=True), transient=True,
    )  # fmt: skip
