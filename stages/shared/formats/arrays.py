"""NumPy's .npy and .npz, read with every size checked before memory is taken for it, and never a pickle."""

from __future__ import annotations

import io
import math
import warnings
import zipfile
import zlib
from collections.abc import Collection

import numpy as np

from data_schemas.errors import InputError

MAX_ARRAY_BYTES = 1 << 30
MAX_RATIO = 100  # unpacked over packed; recorded numbers pack two or three times
_RATIO_COUNTS_FROM = 64 << 20
_KINDS = "biufSU"  # numbers and plain text; no objects, no records


class PickledArray(InputError):
    """An array of Python objects, which only unpickling could give."""


def read_array(data: bytes, name: str) -> np.ndarray:
    """The array of a .npy's bytes, in the machine's byte order. Raises InputError; PickledArray for objects."""
    stream = io.BytesIO(data)
    try:
        version = np.lib.format.read_magic(stream)
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a header in an old spelling is read all the same
            shape, by_columns, dtype = header(stream)
    except Exception:  # the header is a Python literal, whose parser raises whatever it meets
        raise InputError(f"{name} is no NumPy array or is damaged.") from None
    if dtype.hasobject:
        raise PickledArray(f"{name} holds Python objects, which are never unpickled.", "Save it as plain numbers.")
    if dtype.kind not in _KINDS or dtype.itemsize == 0 or any(n < 0 for n in shape) or len(shape) > 8:
        raise InputError(f"{name} has the type {str(dtype)[:40]} and shape {str(shape)[:60]}, which is no motion's.")
    size = math.prod(shape) * dtype.itemsize
    if size > MAX_ARRAY_BYTES or size != len(data) - stream.tell():
        raise InputError(
            f"{name} says it holds {size} bytes of numbers, and {len(data) - stream.tell()} follow.",
            "Is the file truncated?",
        )
    flat = np.frombuffer(data, dtype, offset=stream.tell())
    array = flat.reshape(shape, order="F" if by_columns else "C")
    return array.astype(dtype.newbyteorder("="), copy=False)


def array_names(data: bytes, name: str) -> tuple[str, ...]:
    """Names of the arrays in a .npz. Raises InputError where it is none."""
    with _opened(data, name) as archive:
        return tuple(member.removesuffix(".npy") for member in archive.namelist())


def read_arrays(data: bytes, name: str, wanted: Collection[str]) -> tuple[dict[str, np.ndarray], list[str]]:
    """Those of the wanted arrays that a .npz holds.

    Returns: the arrays by name, and the names of those that were left out because they are pickled.
    Raises: InputError naming file and array where one is damaged or would fill the memory.
    """
    arrays: dict[str, np.ndarray] = {}
    pickled: list[str] = []
    with _opened(data, name) as archive:
        chosen = [info for info in archive.infolist() if info.filename.removesuffix(".npy") in wanted]
        total = sum(info.file_size for info in chosen)
        if total > MAX_ARRAY_BYTES or total > max(_RATIO_COUNTS_FROM, MAX_RATIO * len(data)):
            raise InputError(f"{name} would unpack to {total / 1e6:.0f} MB.", "That is no recording.")
        for info in chosen:
            key = info.filename.removesuffix(".npy")
            try:
                with archive.open(info) as file:
                    # The list may understate the size; read no more than it says, and one byte.
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
        raise InputError(f"{name} is no NumPy archive or is damaged.", "Fetch it again.") from None
    if len(archive.namelist()) > 10_000:
        raise InputError(f"{name} holds {len(archive.namelist())} arrays, which is no recording.")
    return archive
