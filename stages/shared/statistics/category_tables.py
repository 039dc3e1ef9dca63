"""Tables by category of motion.

PUMPS Tables 3 and 4 have one column for each category, which is read from the file names.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath

import numpy as np

from data_schemas.clips import ClipRow
from data_schemas.metrics import MetricRow
from stages.shared.statistics.bootstrap import mean_interval
from stages.shared.statistics.categories import category_of
from stages.shared.statistics.table import Entry, Row, Table

ALL = "all"


def word_or_category(row: ClipRow, patterns: Mapping[str, str]) -> str | None:
    """As `category_of`; without patterns the first word of the file's name: walk of walk3_subject4.bvh."""
    if patterns:
        return category_of(row, patterns)
    stem = PurePosixPath(row.source.replace("\\", "/").rsplit("!", 1)[-1]).stem
    found = re.match(r"[^\W\d_]+", stem)
    return found[0] if found else "other"


def table_of(rows: Sequence[MetricRow], metric: str, seed: int, decimals: int = 1) -> Table:
    """Methods by category, which rows have as their archive, and over all clips with a 95% bootstrap interval over
    clips. Values are means over windows."""
    categories = sorted({row.archive for row in rows})
    found = []
    for method in dict.fromkeys(row.method for row in rows):
        own = [row for row in rows if row.method == method and row.metric == metric]
        entries = []
        for category in (*categories, ALL):
            some = [row for row in own if category in (row.archive, ALL)]
            values, windows = (np.array([getattr(row, name) for row in some], float) for name in ("value", "windows"))
            estimate = mean_interval(values, windows, seed)
            wide = category == ALL and estimate.low is not None
            span = f"[{estimate.low:.{decimals}f}, {estimate.high:.{decimals}f}]" if wide else ""
            entries.append(Entry(f"{estimate.value:.{decimals}f}", span))
        found.append(Row((method,), tuple(entries)))
    return Table(("method",), (*categories, ALL), tuple(found))
