"""Digests of the content of data files: arrays, tables and settings, independent of compression and recorded times.

Two runs with the same inputs, settings and seed make the same arrays, but not always the same bytes: LZF, which
compresses older artefacts, does not clear its table, and a training records its duration. An artefact's digest
is made of these:

    *.h5                    every group, attribute and array: name, type, shape, values
    *.parquet               every column: name, type, values
    config.json             the settings, without the minutes and seconds of trainings
    log.parquet             its columns without `seconds`
    MODEL_CARD.md           left out: a text for people that is made from the settings and names the minutes
    all other files         their bytes

The sha256 of each file's bytes stands in the manifest beside it, so that `verify` finds every change of these files.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
from h5py import h5l  # type: ignore[attr-defined]
from h5py.h5o import open as open_object

from data_schemas.declared_sizes import check_stored_array, read_table
from data_schemas.manifest import sha256_of_file

_PIECE_BYTES = 8 << 20
_HARD = h5l.TYPE_HARD  # not a soft or an external link
_DEEPEST = 16
# Of a checkpoint: columns of the log and keys of the settings that say how long it took, and texts that repeat them.
_CLOCK_COLUMNS = {"log.parquet": frozenset({"seconds"})}
_CLOCK_KEYS = {"config.json": frozenset({("trainings", "minutes"), ("place", "seconds")})}
_TEXTS_WITH_CLOCKS = frozenset({"MODEL_CARD.md"})


def content_digest(path: Path, kind: str, sha256: str | None = None) -> str | None:
    """Hex sha256 of the content of a data file of an artefact of `kind`; None for a file that is left out.

    Args:
        sha256: of the file's bytes, if it is known already.

    Raises: OSError, ValueError, RuntimeError or ArrowException if it cannot be read as its name says.
    """
    name = path.name
    clocks = kind == "checkpoint"
    if clocks and name in _TEXTS_WITH_CLOCKS:
        return None
    if name.endswith(".h5"):
        return _digest_of_hdf5(path)
    if name.endswith(".parquet"):
        return _digest_of_table(path, _CLOCK_COLUMNS.get(name, frozenset()) if clocks else frozenset())
    if clocks and name in _CLOCK_KEYS:
        return _digest_of_settings(path, _CLOCK_KEYS[name])
    return sha256 or sha256_of_file(path)


def _digest_of_settings(path: Path, clocks: frozenset[tuple[str, str]]) -> str:
    values = json.loads(path.read_text(encoding="utf-8"))
    for outer, inner in clocks:
        there = values.get(outer) if isinstance(values, dict) else None
        for each in there if isinstance(there, list) else [there]:
            if isinstance(each, dict):
                each.pop(inner, None)
    return hashlib.sha256(json.dumps(values, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _digest_of_table(path: Path, without: frozenset[str]) -> str:
    table = read_table(path)
    total = hashlib.sha256(f"{table.num_rows}\n".encode())
    for name in sorted(set(table.column_names) - without):
        column = table.column(name)
        _add_label(total, "column", name, str(column.type))
        for part in _column_parts(column):
            total.update(part)
    return total.hexdigest()


def _column_parts(column: pa.ChunkedArray) -> Iterator[bytes]:
    """A column's values as bytes, whatever its encoding: which are missing, then the values."""
    whole = column.combine_chunks()
    array = pa.concat_arrays(whole.chunks) if isinstance(whole, pa.ChunkedArray) else whole
    yield np.asarray(array.is_null().to_numpy(zero_copy_only=False), np.uint8).tobytes()
    kind = array.type
    if pa.types.is_string(kind):
        texts = [text.encode() for text in array.fill_null("").to_pylist()]
        yield np.array([len(text) for text in texts], "<i8").tobytes()
        yield b"".join(texts)
    elif pa.types.is_boolean(kind):
        yield np.asarray(array.fill_null(False).to_numpy(zero_copy_only=False), np.uint8).tobytes()
    elif pa.types.is_integer(kind) or pa.types.is_floating(kind):
        yield np.ascontiguousarray(array.fill_null(0).to_numpy(zero_copy_only=False)).tobytes()
    else:
        yield json.dumps(array.to_pylist(), sort_keys=True, default=str).encode()


def _digest_of_hdf5(path: Path) -> str:
    total = hashlib.sha256()
    with h5py.File(path, "r", locking=False) as file:
        _add_group(total, file, 0, set())
    return total.hexdigest()


# HDF5's own functions are called where h5py's take several times as long, which counts for many short clips.


def _add_group(total: Any, group: h5py.Group, depth: int, seen: set[int]) -> None:
    place = h5py.h5o.get_info(group.id).addr  # type: ignore[attr-defined]
    if depth > _DEEPEST or place in seen:
        raise ValueError(f"{group.name} is linked in a circle, or lies too deep")
    seen.add(place)
    _add_attributes(total, group)
    here: Any = group.id
    for name in sorted(group):
        raw = name.encode("utf-8", "surrogateescape")
        if here.links.get_info(raw).type != _HARD:
            raise ValueError(f"{group.name}/{name} is a link")
        item = open_object(here, raw)
        if isinstance(item, h5py.h5g.GroupID):
            _add_label(total, "group", name)
            _add_group(total, h5py.Group(item), depth + 1, seen)
        elif isinstance(item, h5py.h5d.DatasetID):
            _add_array(total, name, h5py.Dataset(item))
    _add_label(total, "end")


def _add_array(total: Any, name: str, stored: h5py.Dataset) -> None:
    low: Any = stored.id
    made, kind, shape = low.get_create_plist(), low.dtype, low.shape
    layout = made.get_layout()
    if layout == h5py.h5d.VIRTUAL or made.get_external_count() or kind.kind not in "biuf":
        raise ValueError(f"{stored.name} is not an array of numbers within this file")
    check_stored_array(stored)
    _add_label(total, "array", name, kind.str, str(shape))
    _add_attributes(total, stored)
    size = math.prod(shape) * kind.itemsize
    chunk = made.get_chunk()[0] if layout == h5py.h5d.CHUNKED else size
    if size <= _PIECE_BYTES or chunk >= shape[0]:
        values = np.empty(shape, kind)
        if values.size:
            low.read(h5py.h5s.ALL, h5py.h5s.ALL, values)
        total.update(values.reshape(-1).view(np.uint8).data)
        return
    step = chunk * max(1, _PIECE_BYTES * shape[0] // (size * chunk))  # whole chunks, a few megabytes at a time
    for start in range(0, shape[0], step):
        total.update(np.ascontiguousarray(stored[start : start + step]))


def _add_attributes(total: Any, item: h5py.Group | h5py.Dataset) -> None:
    if not h5py.h5a.get_num_attrs(item.id):
        return
    attributes = item.attrs
    for name in sorted(attributes):
        value = attributes[name]
        if isinstance(value, str):
            _add_label(total, "text", name, value)
        else:
            array = np.asarray(value)
            if array.dtype.kind not in "biufSU":
                raise ValueError(f"{item.name} has an attribute {name} that is neither number nor text")
            _add_label(total, "attribute", name, array.dtype.str, str(array.shape))
            total.update(np.ascontiguousarray(array).tobytes())


def _add_label(total: Any, *words: str) -> None:
    total.update(json.dumps(words).encode())
