"""Windows of mesh sequences: where they start, and drawing some of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data_schemas.clips import ClipRow
from data_schemas.errors import InputError


@dataclass(frozen=True)
class MeshWindow:
    """Frames `start` to `stop` (not included) of a clip."""

    clip: str
    start: int
    stop: int


class WindowList:
    """All windows of some clips, by index; nothing is read from the disk.

    Args:
        rows: clips; those shorter than a window are left out, and `short` counts them.
        frames: of a window. stride: frames between starts.

    Raises: InputError if no clip is long enough.
    """

    def __init__(self, rows: Sequence[ClipRow], frames: int, stride: int):
        self.rows = [row for row in rows if row.frames >= frames]
        self.short = len(rows) - len(self.rows)
        if not self.rows:
            longest = max((row.frames for row in rows), default=0)
            raise InputError(
                f"No clip has the {frames} frames of a window; the longest has {longest}.",
                "Give longer clips, or choose a shorter window.",
            )
        self.frames, self.stride = frames, stride
        self._ends = np.cumsum([(row.frames - frames) // stride + 1 for row in self.rows])

    def __len__(self) -> int:
        return int(self._ends[-1])

    def __getitem__(self, index: int) -> MeshWindow:
        clip = int(np.searchsorted(self._ends, index, side="right"))
        start = (index - (int(self._ends[clip - 1]) if clip else 0)) * self.stride
        return MeshWindow(self.rows[clip].clip, start, start + self.frames)

    def spread(self, count: int) -> list[MeshWindow]:
        """At most `count` windows, evenly spread over all."""
        chosen = np.unique(np.linspace(0, len(self) - 1, min(count, len(self))).round().astype(int))
        return [self[int(index)] for index in chosen]
