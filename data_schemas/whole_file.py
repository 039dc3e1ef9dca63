"""Writing files atomically: to a temporary file in the same folder, which is flushed to the disk and then renamed."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from data_schemas.disk import (
    cannot_be_written,
    check_room,
    flush_to_disk,
    missing_above,
    refuse_special,
    remove_empty,
)


def write_whole(path: Path, data: bytes) -> None:
    """Write a file that appears whole or not at all; missing folders are created, an old file is replaced.

    The bytes are on the disk before the old file is replaced, and the new name is on the disk before this returns, so
    that a power cut leaves the old file or the new one.

    Raises:
        UsageError: `path` is a link, a device, a pipe or a socket.
        PumpsError: it cannot be written; the old file is unchanged, and folders that were created are removed.
    """
    refuse_special(path)
    check_room(path, len(data))
    missing = missing_above(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, draft = tempfile.mkstemp(prefix=".pumps-", dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(data)
                file.flush()
                if hasattr(os, "fchmod"):  # Windows has no such permissions
                    os.fchmod(file.fileno(), 0o666 & ~_umask())
                os.fsync(file.fileno())
            os.replace(draft, path)
        except BaseException:
            Path(draft).unlink(missing_ok=True)
            raise
        flush_to_disk(path.parent)
    except OSError as error:
        remove_empty(missing)  # another program may have written into one of them
        raise cannot_be_written(path, error) from None


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
