"""Windows of one rig's held-out clips by category of motion, to measure on (PUMPS Tables 3 and 4)."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import numpy as np

from data_schemas.clips import ClipRow
from data_schemas.errors import InputError
from stages.shared.statistics.categories import named
from stages.shared.statistics.category_tables import word_or_category


def windows_by_category(
    clips: Sequence[ClipRow],
    rigs: Collection[str],
    splits: Sequence[str],
    categories: Sequence[str],
    window: int,
    most: int,
    source: object,
) -> Iterator[tuple[str, ClipRow, list[int]]]:
    """Category, clip and the first frames of its windows, which do not overlap.

    Args:
        rigs: ids of the rig's sets of bones. categories: NAME=PATTERN. window: frames.
        most: windows of a category, spread evenly over its clips; 0 for all. source: the artefact, for messages.

    Raises: InputError if there is no window.
    """
    patterns = named("category", categories)
    by_category: dict[str, list[tuple[ClipRow, int]]] = {}
    for row in sorted(clips, key=lambda row: row.clip):
        if row.split in splits and row.skeleton in rigs and row.frames >= window:
            category = word_or_category(row, patterns)
            if category is not None:
                starts = range(0, row.frames - window + 1, window)
                by_category.setdefault(category, []).extend((row, start) for start in starts)
    if not by_category:
        raise InputError(
            f"{source} has no clip of the rig with {window} frames in {', '.join(splits)}.",
            "Name another split with --splits, or patterns that match with --category.",
        )
    for category, found in sorted(by_category.items()):
        if most and len(found) > most:
            found = [found[i] for i in np.linspace(0, len(found) - 1, most).round().astype(int)]
        for clip in dict.fromkeys(row.clip for row, _ in found):
            mine = [(row, start) for row, start in found if row.clip == clip]
            yield category, mine[0][0], [start for _, start in mine]
