"""The version of pumps that artefacts record (a test compares it with pyproject.toml), and the digest of its code."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

PUMPS_VERSION = "0.1.0"

_ROOT = Path(__file__).resolve().parents[1]
_PACKAGES = ("data_schemas", "stages")  # what results depend on; the command line and its help are left out
_SUFFIXES = (".py", ".toml")


@cache
def code_digest() -> str:
    """SHA-256 of the code that results depend on: path and content of each `.py` and `.toml` of the two packages."""
    digest = hashlib.sha256()
    for package in _PACKAGES:
        for path in sorted((_ROOT / package).rglob("*")):
            if path.suffix in _SUFFIXES:
                content = path.read_bytes().replace(b"\r\n", b"\n")
                digest.update(f"{path.relative_to(_ROOT).as_posix()}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()
