"""The container of a GLB, for tests that change what is inside."""

from __future__ import annotations

import struct


def parts_of_glb(data: bytes) -> tuple[bytes, bytes]:
    """The JSON of a GLB, and what follows it."""
    length = struct.unpack_from("<I", data, 12)[0]
    return data[20 : 20 + length], data[20 + length :]


def glb_with(text: bytes, rest: bytes) -> bytes:
    """A GLB of a JSON, sound or not, and of what follows it, with lengths that are right."""
    padded = text + b" " * (-len(text) % 4)
    return struct.pack("<4sIII4s", b"glTF", 2, 20 + len(padded) + len(rest), len(padded), b"JSON") + padded + rest
