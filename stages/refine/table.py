"""The table of anchors that were judged, as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence


def csv_of(rows: Sequence[dict]) -> bytes:
    """One line an anchor; the heads are the keys of the mappings, at least one."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(rows[0])
    for row in rows:
        writer.writerow([f"{value:g}" if isinstance(value, int | float) else value for value in row.values()])
    return text.getvalue().encode()
