"""Reading NumPy's .npy and .npz safely: sizes are checked before memory is allocated, pickles are never loaded."""

from __future__ import annotations

import io
import math
import sys
import warnings
import zipfile
import zlib
from collections.abc import Collection

import numpy as np

from data_schemas.errors import InputError

MAX_ARRAY_BYTES = 1 << 30
MAX_RATIO = 100  # unpacked over packed; 2 or 3 for recorded numbers
_RATIO_COUNTS_FROM = 64 << 20
_KINDS = "biufSU"  # numbers and plain text; no objects, no records


class PickledArray(InputError):
    """An array of Python objects, which could only be read by unpickling."""


def read_array(data: bytes, name: str) -> np.ndarray:
    """The array of a .npy's bytes, in the machine's byte order. Raises InputError; PickledArray for objects."""
    stream = io.BytesIO(data)
    try:
        version = np.lib.format.read_magic(stream)
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # old spellings of the header are read too
            shape, by_columns, dtype = header(stream)
    except Exception:  # the header is a Python literal, and its parser may raise anything
        raise InputError(f"{name} is not a NumPy array or is damaged.") from None
    if dtype.hasobject:
        raise PickledArray(f"{name} holds Python objects, which are never unpickled.", "Save it as plain numbers.")
    if dtype.kind not in _KINDS or dtype.itemsize == 0 or any(n < 0 for n in shape) or len(shape) > 8:
        raise InputError(
            f"{name} has the type {str(dtype)[:40]} and shape {str(shape)[:60]}; motion is stored as plain numbers."
        )
    size = math.prod(shape) * dtype.itemsize
    if size > MAX_ARRAY_BYTES or size != len(data) - stream.tell():
        raise InputError(
            f"{name} declares {size} bytes of numbers but holds {len(data) - stream.tell()}.",
            "Is the file truncated?",
        )
    flat = np.frombuffer(data, dtype, offset=stream.tell())
    if dtype.kind == "U":  # UTF-32: reading a number above the last code point is a SystemError
        letters = np.frombuffer(data, np.dtype(np.uint32).newbyteorder(dtype.byteorder), offset=stream.tell())
        if letters.size and letters.max() > sys.maxunicode:
            raise InputError(f"{name} holds text that is damaged.", "Fetch it again.")
    array = flat.reshape(shape, order="F" if by_columns else "C")
    return array.astype(dtype.newbyteorder("="), copy=False)


def array_names(data: bytes, name: str) -> tuple[str, ...]:
    """Names of the arrays in a .npz. Raises InputError if the data are not a .npz."""
    with _opened(data, name) as archive:
        return tuple(member.removesuffix(".npy") for member in archive.namelist())


def read_arrays(data: bytes, name: str, wanted: Collection[str]) -> tuple[dict[str, np.ndarray], list[str]]:
    """Read the wanted arrays that a .npz holds.

    Returns: the arrays by name, and the names of pickled arrays, which are left out.
    Raises: InputError naming file and array if one is damaged or would fill the memory.
    """
    arrays: dict[str, np.ndarray] = {}
    pickled: list[str] = []
    with _opened(data, name) as archive:
        chosen = [info for info in archive.infolist() if info.filename.removesuffix(".npy") in wanted]
        total = sum(info.file_size for info in chosen)
        if total > MAX_ARRAY_BYTES or total > max(_RATIO_COUNTS_FROM, MAX_RATIO * len(data)):
            raise InputError(f"{name} would unpack to {total / 1e6:.0f} MB.", "That is not a recording.")
        for info in chosen:
            key = info.filename.removesuffix(".npy")
            try:
                with archive.open(info) as file:
                    # A hostile file may list a size that is too small: read one byte more than that, and no further.
                    content = file.read(info.file_size + 1)
            except (
                zipfile.BadZipFile,
                zlib.error,
                EOFError,
                NotImplementedError,
                RuntimeError,
                LookupError,
                OSError,
                ValueError,
            ):
                raise InputError(f"{name}: its array '{key}' is damaged.", "Fetch it again.") from None
            try:
                arrays[key] = read_array(content, f"{name}: the array '{key}'")
            except PickledArray:
                pickled.append(key)
    return arrays, pickled


def _opened(data: bytes, name: str) -> zipfile.ZipFile:
    try:
        archive = zipfile.ZipFile(io.BytesIO(data))
    except (zipfile.BadZipFile, LookupError, OSError, ValueError, NotImplementedError, RuntimeError, OverflowError):
        raise InputError(f"{name} is not a NumPy archive or is damaged.", "Fetch it again.") from None
    if len(archive.namelist()) > 10_000:
        raise InputError(f"{name} holds {len(archive.namelist())} arrays, which is not a recording.")
    return archive
