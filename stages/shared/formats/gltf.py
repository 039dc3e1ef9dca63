"""Reading glTF 2.0 and GLB: the parts that motion needs, with every index and size checked before it is used."""

from __future__ import annotations

import base64
import binascii
import json
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from data_schemas.errors import InputError

_JSON, _BIN = 0x4E4F534A, 0x004E4942
_MOST_PARTS = 500_000  # objects, lists and texts in the JSON
_TYPES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_COMPONENTS = {
    5120: np.dtype("<i1"), 5121: np.dtype("<u1"), 5122: np.dtype("<i2"), 5123: np.dtype("<u2"),
    5125: np.dtype("<u4"), 5126: np.dtype("<f4"),
}  # fmt: skip


@contextmanager
def reading_gltf(name: str) -> Iterator[None]:
    """Turn the errors that wrong types and missing keys in the JSON raise into one InputError that names the file."""
    try:
        yield
    except InputError:
        raise
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, struct.error) as error:
        reason = " ".join(str(error).split())[:100]
        raise InputError(f"{name} is not a sound glTF file ({type(error).__name__}: {reason}).") from None


class Document:
    """A glTF file: its JSON, and numbers read from its buffers.

    Use inside `reading_gltf`. Raises InputError naming the file.
    """

    def __init__(self, data: bytes, name: str):
        self.name = name
        text, self._binary = _container(data, name)
        if text.count(b"{") + text.count(b"[") + text.count(b'"') // 2 > _MOST_PARTS:
            raise InputError(f"{name} has more than {_MOST_PARTS} parts.", "Export the skeleton and its skin alone.")
        try:
            self.json: dict[str, Any] = json.loads(text)
        except (ValueError, RecursionError):
            raise InputError(f"{name}: its JSON cannot be read.", "Is the file truncated?") from None
        if not isinstance(self.json, dict) or not str(self.json["asset"]["version"]).startswith("2"):
            raise InputError(f"{name} is not glTF 2.0.", "Export it again as glTF 2.0.")
        self._lists: dict[str, list[dict[str, Any]]] = {}
        self._buffers: dict[int, bytes] = {}
        self._numbers: dict[int, np.ndarray] = {}
        self._budget = 8 * len(data) + (16 << 20)  # bytes for all accessors together, since they may overlap

    def items(self, key: str) -> list[dict[str, Any]]:
        """One of the top-level lists, each entry a mapping."""
        if key not in self._lists:
            listed = self.json.get(key, [])
            if not isinstance(listed, list) or not all(isinstance(item, dict) for item in listed):
                raise InputError(f"{self.name}: its {key} must be a list of objects.")
            self._lists[key] = listed
        return self._lists[key]

    def index(self, value: Any, key: str) -> int:
        """`value`, checked to be an index into a top-level list."""
        if type(value) is not int or not 0 <= value < len(self.items(key)):
            raise InputError(f"{self.name} refers to entry {str(value)[:20]} of its {key}, which does not exist.")
        return value

    def numbers(self, accessor: Any) -> np.ndarray:
        """(count, width) float64 values of an accessor; normalised integers are converted to fractions."""
        index = self.index(accessor, "accessors")
        if index not in self._numbers:
            self._numbers[index] = self._read(self.items("accessors")[index], index)
        return self._numbers[index]

    def _read(self, accessor: dict[str, Any], index: int) -> np.ndarray:
        where = f"{self.name}: accessor {index}"
        if "sparse" in accessor or "bufferView" not in accessor:
            raise InputError(f"{where} is sparse, which is not read.", "Export it without sparse accessors.")
        dtype, width, count = _COMPONENTS[accessor["componentType"]], _TYPES[accessor["type"]], accessor["count"]
        view = self.items("bufferViews")[self.index(accessor["bufferView"], "bufferViews")]
        row = dtype.itemsize * width
        stride = view.get("byteStride", row)
        start = accessor.get("byteOffset", 0)
        if any(type(value) is not int or value < 0 for value in (count, stride, start)) or stride < row or count < 1:
            raise InputError(f"{where} has an impossible count, stride or offset.")
        content = self._view(view, where)
        if start + stride * (count - 1) + row > len(content):
            raise InputError(f"{where} reaches beyond its buffer.", "Is the file truncated?")
        self._budget -= 8 * width * count
        if self._budget < 0:
            raise InputError(f"{self.name}: its accessors hold more numbers than a file of its size.")
        values = np.ndarray((count, width), dtype, content, start, (stride, dtype.itemsize)).astype(np.float64)
        if accessor.get("normalized") and dtype.kind in "iu":
            values = np.maximum(values / np.iinfo(dtype).max, -1.0)
        if not np.isfinite(values).all() or np.abs(values).max() > 1e9:
            raise InputError(f"{where} holds values that are not finite, or far too large.")
        return values

    def _view(self, view: dict[str, Any], where: str) -> memoryview:
        start, length = view.get("byteOffset", 0), view["byteLength"]
        buffer = self._buffer(self.index(view["buffer"], "buffers"))
        if type(start) is not int or type(length) is not int or start < 0 or length < 0:
            raise InputError(f"{where} has a buffer view with an impossible offset or length.")
        if start + length > len(buffer):
            raise InputError(f"{where} reaches beyond its buffer.", "Is the file truncated?")
        return memoryview(buffer)[start : start + length]

    def _buffer(self, index: int) -> bytes:
        if index not in self._buffers:
            uri = self.items("buffers")[index].get("uri")
            if uri is None and index == 0 and self._binary is not None:
                self._buffers[index] = self._binary
            elif isinstance(uri, str) and uri.startswith("data:") and ";base64," in uri[:200]:
                try:
                    self._buffers[index] = base64.b64decode(uri.partition(",")[2], validate=True)
                except (binascii.Error, ValueError):
                    raise InputError(f"{self.name}: buffer {index} is not base64.") from None
            else:
                raise InputError(
                    f"{self.name} keeps its numbers in another file.", "Export it as GLB, which includes them."
                )
        return self._buffers[index]


def _container(data: bytes, name: str) -> tuple[bytes, bytes | None]:
    """The bytes of the JSON, and of a GLB's binary part."""
    if not data.startswith(b"glTF"):
        return data.removeprefix(b"\xef\xbb\xbf"), None
    parts: dict[int, bytes] = {}
    at = 12
    while at + 8 <= len(data):
        length, kind = struct.unpack_from("<II", data, at)
        if at + 8 + length > len(data):
            raise InputError(f"{name}: a part of {length} bytes is cut off.", "Is the file truncated?")
        parts.setdefault(kind, data[at + 8 : at + 8 + length])
        at += 8 + length + (-length % 4)
    if _JSON not in parts:
        raise InputError(f"{name} is a GLB without its JSON.", "Is the file truncated?")
    return parts[_JSON], parts.get(_BIN)
