"""Writing files atomically: to a temporary file in the same folder, which is then renamed."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from data_schemas.errors import PumpsError


def write_whole(path: Path, data: bytes) -> None:
    """Write a file that appears whole or not at all; missing folders are created, an old file is replaced.

    Raises: PumpsError if it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, draft = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(data)
            os.chmod(draft, 0o666 & ~_umask())
            os.replace(draft, path)
        except BaseException:
            Path(draft).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise PumpsError(
            f"{path} cannot be written: {error.strerror}.", "Check the folder and its free space."
        ) from None


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
