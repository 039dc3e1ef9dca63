"""A table independent of Markdown, text or HTML: labels, and entries with their interval and ratio as parts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

Verdict = Literal["", "better", "same", "worse"]


@dataclass(frozen=True)
class Entry:
    """One entry, as printed parts.

    value: the mean. span: its interval, "[0.38, 0.45]". ratio: to the baseline, "×0.81*".
    verdict: the conclusion from the ratio's interval; "" without a ratio.
    """

    value: str = ""
    span: str = ""
    ratio: str = ""
    verdict: Verdict = ""

    @property
    def text(self) -> str:
        """The parts, separated by spaces."""
        return " ".join(part for part in (self.value, self.span, self.ratio) if part)


@dataclass(frozen=True)
class Row:
    """One row: a text for each column of labels, then an entry for each column of numbers."""

    labels: tuple[str, ...]
    entries: tuple[Entry, ...]

    def texts(self) -> list[str]:
        """All columns as text."""
        return [*self.labels, *(entry.text for entry in self.entries)]

    def markdown(self) -> str:
        """The row as a line of Markdown."""
        return _line(self.texts())


@dataclass(frozen=True)
class Table:
    """Heads of the columns of labels and of numbers, and the rows. A label that is "" repeats the one above."""

    labels: tuple[str, ...]
    columns: tuple[str, ...]
    rows: tuple[Row, ...]

    def markdown(self) -> list[str]:
        """Lines of Markdown: numbers are aligned to the right."""
        return [
            _line([*self.labels, *self.columns]),
            f"|{'---|' * len(self.labels)}{'---:|' * len(self.columns)}",
            *(row.markdown() for row in self.rows),
        ]


def without_repeats(rows: Iterable[Row]) -> tuple[Row, ...]:
    """The rows with each label left empty that repeats the row above, as do all labels before it."""
    shown: list[Row] = []
    last: tuple[str, ...] = ()
    for row in rows:
        labels = tuple("" if row.labels[: i + 1] == last[: i + 1] else text for i, text in enumerate(row.labels))
        shown.append(Row(labels, row.entries))
        last = row.labels
    return tuple(shown)


def _line(texts: Sequence[str]) -> str:
    return f"| {' | '.join(text.replace('|', chr(92) + '|') for text in texts)} |"
