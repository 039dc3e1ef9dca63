"""Frames of rigid clips, read from the disk on demand; a limited number of bytes is kept in memory."""

from __future__ import annotations

from collections import OrderedDict
from threading import Lock
from typing import Any

import numpy as np

from data_schemas.hdf5_arrays import CHUNK_FRAMES
from data_schemas.tpc import TpcReader


class FrameCache:
    """Reads whole chunks of the HDF5 file and keeps the most recently used ones.

    The limit does not change what is read, so batches do not depend on it. Several threads may read at once. A copy
    that is sent to another process starts empty.

    Args:
        reader: the tpc artefact.
        limit_mb: most megabytes to keep; 0 keeps nothing.
    """

    def __init__(self, reader: TpcReader, limit_mb: float):
        self.reader, self.limit_mb = reader, limit_mb
        self._kept: OrderedDict[tuple[str, int], np.ndarray] = OrderedDict()
        self._lock = Lock()
        self.kept_bytes = 0

    def frames(self, clip: str, start: int, stop: int) -> np.ndarray:
        """Frames `start` to `stop` of a clip, (n, J, 7) float32: each bone's head, metres, and rotation, xyzw.

        Raises: InputError if the file is damaged, or the clip is not rigid.
        """
        first, last = start // CHUNK_FRAMES, (stop - 1) // CHUNK_FRAMES
        pieces = [self._piece(clip, number) for number in range(first, last + 1)]
        whole = pieces[0] if len(pieces) == 1 else np.concatenate(pieces)
        return whole[start - first * CHUNK_FRAMES : stop - first * CHUNK_FRAMES]

    def _piece(self, clip: str, number: int) -> np.ndarray:
        key = (clip, number)
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        start = number * CHUNK_FRAMES
        stop = min(start + CHUNK_FRAMES, self.reader.row(clip).frames)
        piece = np.concatenate(self.reader.transforms(clip, start, stop), axis=-1)
        with self._lock:
            if key not in self._kept and piece.nbytes <= self.limit_mb * 1e6:
                self._kept[key] = piece
                self.kept_bytes += piece.nbytes
                while self.kept_bytes > self.limit_mb * 1e6:
                    self.kept_bytes -= self._kept.popitem(last=False)[1].nbytes
        return piece

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.reader, self.limit_mb)
