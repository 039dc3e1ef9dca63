"""Writing to the disk: flushing, checking the free space first, and one error if the disk refuses."""

from __future__ import annotations

import errno
import os
import shutil
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from data_schemas.errors import PumpsError, UsageError

# Faults of writing alone: the disk or a quota is full, a file may not grow further, the disk is read-only.
WRITING_FAULTS = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS})
_FLUSHED_AS = os.O_RDWR if os.name == "nt" else os.O_RDONLY  # Windows flushes only what is open for writing
_DISK_FAULTS = WRITING_FAULTS | {errno.EIO}


def flush_to_disk(path: Path) -> None:
    """Flush a file, or a folder's list of names, to the disk. Raises OSError if the disk refuses."""
    try:
        descriptor = os.open(path, _FLUSHED_AS)
    except PermissionError:  # folders cannot be opened on every system
        return
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # file systems that cannot flush folders
            raise
    finally:
        os.close(descriptor)


def write_flushed(path: Path, data: bytes) -> None:
    """Write a new file and flush it. Raises OSError if the disk refuses, FileExistsError if the file exists."""
    with open(path, "xb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def missing_above(path: Path) -> list[Path]:
    """The folders above a path that are not there, the lowest first."""
    return [folder for folder in path.parents if not folder.exists()]


def remove_empty(folders: Iterable[Path]) -> None:
    """Remove those of the folders, the lowest first, that are there and empty."""
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()


def cannot_be_written(path: object, error: OSError) -> PumpsError:
    """The error for a path that the disk refuses to write."""
    reason = os.strerror(error.errno) if error.errno else (error.strerror or str(error))
    hint = "Free space on that disk, or give another output." if error.errno in _DISK_FAULTS else "Check the folder."
    return PumpsError(f"{path} cannot be written: {reason}.", hint)


@contextmanager
def disk_faults_reported(path: object) -> Iterator[None]:
    """Turn an OSError that says that the disk is full, broken or read-only into a PumpsError that names `path`.

    Other errors pass through.
    """
    try:
        yield
    except OSError as error:
        if error.errno not in _DISK_FAULTS:
            raise
        raise cannot_be_written(path, error) from None


def check_room(path: Path, wanted_bytes: int) -> None:
    """Raise PumpsError if the disk that holds `path`, or will hold it, has less than `wanted_bytes` free.

    Args:
        wanted_bytes: what will be written at least: an estimate must be a lower bound.
    """
    place = path.absolute()
    while not place.exists() and place != place.parent:
        place = place.parent
    try:
        free = shutil.disk_usage(place).free
    except OSError:
        return
    if free < wanted_bytes:
        raise PumpsError(
            f"{path} needs {wanted_bytes / 1e6:.1f} MB at least, and its disk has {free / 1e6:.1f} MB free.",
            "Free space on that disk, or give another output.",
        )


def refuse_special(path: Path) -> None:
    """Raise UsageError if `path` is a link, a device, a pipe or a socket, which no output may replace."""
    try:
        mode = os.lstat(path).st_mode
    except OSError:  # there is none, or the write itself reports what is wrong
        return
    if stat.S_ISLNK(mode):
        raise UsageError(f"{path} is a link, which an output does not replace.", "Name the file that it points to.")
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise UsageError(f"{path} is not a plain file, and an output does not replace it.", "Name another file.")
