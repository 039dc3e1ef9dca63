"""What a file declares against what is really in it, compared before memory is taken for it.

A few bytes can declare any number of frames, rows or numbers. Compressed data declare more bytes than they
take, so each limit grows with the bytes that are there, and is far above what this project's data reach.
"""

from __future__ import annotations

import math
import os

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

FREE_BYTES = 1 << 20  # that any file may declare
_LZF_RATIO = 100  # LZF copies at most 264 bytes for 3
# Deflate makes up to 1,032 bytes of one. Packed clouds are stored with it: a tenth to a third of the declared bytes
# if the body moves, nearly nothing if it stays still. So an array may declare what LZF may, and this many bytes more:
# twenty minutes of a body that does not move at all.
_STILL_BYTES = 32 << 20
_TABLE_RATIO = 300
_ROWS_BASE = 10_000  # rows that any table may have; beyond them one for each byte


def check_stored_array(stored: h5py.Dataset) -> None:
    """Raise ValueError if an HDF5 array declares far more bytes than are stored for it."""
    shape = stored.shape
    if shape is None:
        raise ValueError(f"{stored.name} is empty")
    declared = math.prod(shape) * stored.dtype.itemsize
    if declared <= FREE_BYTES:
        return
    kept = int(stored.id.get_storage_size())
    most = (kept if stored.compression is None else _LZF_RATIO * kept) + FREE_BYTES
    if declared > most + (_STILL_BYTES if stored.compression == "gzip" else 0):
        raise ValueError(f"{stored.name} declares {declared / 1e6:.0f} MB, but {kept / 1e6:.3f} MB are stored for it")


def read_table(path: str | os.PathLike[str]) -> pa.Table:
    """Read a whole Parquet file of this project's flat tables.

    Raises: ValueError if it declares far more rows or bytes than its size explains; OSError and ArrowException if it
        is damaged.
    """
    size = os.path.getsize(path)
    most_bytes = _TABLE_RATIO * size + 16 * FREE_BYTES
    with pq.ParquetFile(path) as opened:
        found = opened.metadata
        if found.num_rows > _ROWS_BASE + size:
            raise ValueError(f"it declares {found.num_rows} rows in {size} bytes")
        declared = sum(found.row_group(number).total_byte_size for number in range(found.num_row_groups))
        if declared > most_bytes:
            raise ValueError(f"it declares {declared / 1e6:.0f} MB in {size} bytes")
        fields = list(opened.schema_arrow)
        texts = [field.name for field in fields if _is_text(field.type)]
    # A dictionary holds each text once, however often a row names it: lengths are known before rows are made.
    with pq.ParquetFile(path, read_dictionary=texts) as opened:
        table = opened.read()
    total = sum(_text_bytes(table.column(name)) for name in texts)
    if total > most_bytes:
        raise ValueError(f"its texts would take {total / 1e6:.0f} MB, and the file has {size} bytes")
    columns = [_plain(column) for column in table.columns]
    schema = pa.schema([pa.field(f.name, c.type, nullable=f.nullable) for f, c in zip(fields, columns, strict=True)])
    return pa.Table.from_arrays(columns, schema=schema)


def _is_text(kind: pa.DataType) -> bool:
    return pa.types.is_string(kind) or pa.types.is_binary(kind)


def _text_bytes(column: pa.ChunkedArray) -> int:
    total = 0
    for chunk in column.chunks:
        texts = chunk.dictionary if isinstance(chunk, pa.DictionaryArray) else chunk
        lengths = pc.call_function("binary_length", [texts])
        if isinstance(chunk, pa.DictionaryArray):
            lengths = lengths.take(chunk.indices)
        total += int(lengths.fill_null(0).to_numpy(zero_copy_only=False).sum(dtype=np.int64))
    return total


def _plain(column: pa.ChunkedArray) -> pa.ChunkedArray:
    kind = column.type
    return column.cast(kind.value_type) if pa.types.is_dictionary(kind) else column
