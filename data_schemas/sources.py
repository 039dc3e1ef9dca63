"""Digests of inputs that are not artefacts: source files and folders."""

from __future__ import annotations

import hashlib
from pathlib import Path

from data_schemas.errors import InputError
from data_schemas.manifest import sha256_of_file


def digest_of_source(path: Path) -> tuple[str, str]:
    """Kind ("file" or "folder") and digest of a source.

    A folder's digest covers the relative names and bytes of all plain files in it.

    Raises:
        InputError: it is missing, cannot be read, or is neither file nor folder.
    """
    try:
        if path.is_file():
            return "file", sha256_of_file(path)
        if path.is_dir():
            total = hashlib.sha256()
            for found in sorted(path.rglob("*")):
                if found.is_file():
                    total.update(f"{found.relative_to(path).as_posix()}\0{sha256_of_file(found)}\n".encode())
            return "folder", total.hexdigest()
    except OSError as error:
        raise InputError(f"The input {path} cannot be read: {error.strerror}.") from None
    raise InputError(f"The input {path} does not exist.", "Check the path.")
