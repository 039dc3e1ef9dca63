"""Windows of one rig's held-out clips by category of motion, to measure on (PUMPS Tables 3 and 4)."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from fnmatch import fnmatch
from pathlib import PurePosixPath

import numpy as np

from data_schemas.clips import ClipRow
from data_schemas.errors import InputError


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
    patterns = [(name, pattern) for name, _, pattern in (text.partition("=") for text in categories)]
    by_category: dict[str, list[tuple[ClipRow, int]]] = {}
    for row in sorted(clips, key=lambda row: row.clip):
        if row.split in splits and row.skeleton in rigs and row.frames >= window:
            category = category_of(row, patterns)
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


def category_of(row: ClipRow, patterns: Sequence[tuple[str, str]]) -> str | None:
    """The first category whose pattern the clip's source matches, None if there is none; without patterns the first
    word of the file's name: walk of walk3_subject4.bvh."""
    source = row.source.replace("\\", "/")
    if patterns:
        return next((name for name, pattern in patterns if fnmatch(source, pattern)), None)
    found = re.match(r"[^\W\d_]+", PurePosixPath(source.rsplit("!", 1)[-1]).stem)
    return found[0] if found else "other"
