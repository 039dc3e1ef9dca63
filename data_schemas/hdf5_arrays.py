"""Arrays and texts in HDF5 files: chunked for reading windows, and checked when they are read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import h5py
import numpy as np

from data_schemas.declared_sizes import check_stored_array

CHUNK_FRAMES = 256  # a training window of 128 frames lies in one or two chunks
_UNIT_TOLERANCE = 0.01
_ROTATIONS_AT_ONCE = 1 << 14  # their arrays fit into a processor's cache
_TEXT_LIMIT_BYTES = 64 * 2**20


def write_frames(group: h5py.Group, name: str, values: np.ndarray) -> None:
    """Store an array (T, ...) in chunks of equally many frames, with checksums, for reading windows of it.

    Motions hardly compress: LZF makes their files about a sixth smaller, and takes longer than parsing their
    text (`benchmarks/reading.py`).
    """
    if 0 in values.shape:
        group.create_dataset(name, data=values)
        return
    frames = values.shape[0]
    # HDF5 stores the last chunk in full. With equal chunks, fewer of its frames are empty than there are chunks.
    chunks = -(-frames // -(-frames // CHUNK_FRAMES)), *values.shape[1:]
    group.create_dataset(name, data=values, chunks=chunks, fletcher32=True)


def read_frames(
    group: h5py.Group, name: str, window: slice, shape: tuple[int | None, ...], frames: int
) -> np.ndarray:
    """Read the window of the array `name`; `shape` is that of one frame, None for an axis of any size.

    Raises:
        ValueError: the stored array has another shape than the index and the skeleton say, or is not finite.
    """
    stored = _dataset_in(group, name)
    expected = (frames, *shape)
    if len(stored.shape) != len(expected) or any(
        e is not None and e != s for s, e in zip(stored.shape, expected, strict=True)
    ):
        raise ValueError(f"{group.name}/{name} has the shape {stored.shape}, expected {expected}")
    if stored.dtype.kind not in "fiu" or stored.dtype.itemsize > 8:
        raise ValueError(f"{group.name}/{name} holds {stored.dtype}, expected plain numbers")
    values = np.asarray(stored[window])
    if not np.isfinite(values).all():
        raise ValueError(f"{group.name}/{name} has values that are not finite")
    return values


def read_whole(group: h5py.Group, name: str, dtype: Any, shape: tuple[int | None, ...]) -> np.ndarray:
    """Read the small array `name` of the shape `shape` (None: any size). Raises ValueError for another shape."""
    stored = _dataset_in(group, name)
    if len(stored.shape) != len(shape) or any(
        e is not None and e != s for s, e in zip(stored.shape, shape, strict=True)
    ):
        raise ValueError(f"{group.name}/{name} has the shape {stored.shape}, expected {shape}")
    if stored.size is None or stored.size > 10_000_000:
        raise ValueError(f"{group.name}/{name} is too large")
    return np.asarray(stored[()]).astype(dtype)


def write_text(group: h5py.Group, name: str, text: str) -> None:
    """Store a text as UTF-8 bytes; bytes of the source that were not UTF-8 (lone surrogates) are kept."""
    group.create_dataset(name, data=np.frombuffer(text.encode("utf-8", "surrogatepass"), np.uint8))


def read_text(group: h5py.Group, name: str) -> str:
    """Read a text that `write_text` stored. Raises ValueError for other data."""
    stored = _dataset_in(group, name)
    if stored.dtype != np.uint8 or stored.ndim != 1 or stored.shape[0] > _TEXT_LIMIT_BYTES:
        raise ValueError(f"{group.name}/{name} is not text")
    return np.asarray(stored[()]).tobytes().decode("utf-8", "surrogatepass")


def are_unit(rotations: np.ndarray) -> bool:
    """Whether all quaternions (..., 4) have unit length, within rounding errors."""
    flat = rotations.reshape(-1, 4)
    with np.errstate(all="ignore"):
        for start in range(0, len(flat), _ROTATIONS_AT_ONCE):
            x, y, z, w = flat[start : start + _ROTATIONS_AT_ONCE].astype(np.float32, copy=False).T
            if not (np.abs(x * x + y * y + z * z + w * w - 1) < _UNIT_TOLERANCE).all():  # NaN fails too
                return False
    return True


def group_in(parent: h5py.Group, name: str) -> h5py.Group:
    """The group `name` in `parent` itself. Raises ValueError if there is none."""
    item = _member(parent, name)
    if not isinstance(item, h5py.Group):
        raise ValueError(f"{parent.name}/{name} is not a group")
    return item


def _dataset_in(parent: h5py.Group, name: str) -> h5py.Dataset:
    item = _member(parent, name)
    if not isinstance(item, h5py.Dataset) or item.external or item.is_virtual:
        raise ValueError(f"{parent.name}/{name} is not an array within this file")
    check_stored_array(item)
    return item


def _member(parent: h5py.Group, name: str) -> object:
    # Links are refused: a hostile file could link to other files.
    if not name or "/" in name or name == "." or not isinstance(parent.get(name, getlink=True), h5py.HardLink):
        raise ValueError(f"{parent.name}/{name} is missing")
    return parent[name]


def fault_of_arrays(holder: object, shapes: Mapping[str, tuple[int, ...]]) -> str | None:
    """The first of an object's arrays of another shape or not finite, as the end of a sentence; None if there is
    none."""
    for name, shape in shapes.items():
        values = getattr(holder, name)
        if values.shape != shape:
            return f"has {name} of the shape {values.shape}, expected {shape}"
        if not np.isfinite(values).all():
            return f"has values in {name} that are not finite"
    return None
