"""One writer at a time for each artefact."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from data_schemas.errors import PumpsError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None
# Where there is neither, two writers are not prevented.
msvcrt: Any = import_module("msvcrt") if os.name == "nt" else None

LOCK_NAME = ".pumps-lock"
_LOCK_FLAGS = os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0)

_held: set[Path] = set()
_held_guard = threading.Lock()


@contextmanager
def write_lock(path: Path) -> Iterator[None]:
    """Lock the folder `path` for writing. The system releases the lock of a killed process.

    Raises:
        PumpsError: another process, or another thread of this one, is writing there.
    """
    key = path.resolve()
    with _held_guard:
        if key in _held:
            raise _busy(path)
        _held.add(key)
    try:
        descriptor = _take(path)
        try:
            yield
        finally:
            if descriptor is not None:
                _release(path / LOCK_NAME, descriptor)
    finally:
        with _held_guard:
            _held.discard(key)


def _take(path: Path) -> int | None:
    if fcntl is None and msvcrt is None:
        return None
    while True:
        try:
            descriptor = os.open(path / LOCK_NAME, _LOCK_FLAGS, 0o666)
        except OSError as error:
            raise PumpsError(f"{path} cannot be written: {error.strerror}.") from None
        try:
            _lock(descriptor)
        except (BlockingIOError, PermissionError):
            os.close(descriptor)
            raise _busy(path) from None
        except OSError:  # a file system without locks
            os.close(descriptor)
            return None
        # The previous holder removes the file when it unlocks: a lock on a removed file has no effect.
        with suppress(OSError):
            if os.stat(path / LOCK_NAME).st_ino == os.fstat(descriptor).st_ino:
                return descriptor
        os.close(descriptor)


def _lock(descriptor: int) -> None:
    """Lock an open file. Raises BlockingIOError or PermissionError if another process holds it."""
    if fcntl is not None:
        # A record lock, which worker processes forked by the writer do not inherit.
        fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    else:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)


def _release(file: Path, descriptor: int) -> None:
    """Remove the file and unlock it; Windows removes no open file."""
    if fcntl is None:
        with suppress(OSError):
            msvcrt.locking(descriptor, msvcrt.LK_UNLCK, 1)
        os.close(descriptor)
    with suppress(OSError):  # on Windows, the next writer may have opened it
        file.unlink()
    if fcntl is not None:
        os.close(descriptor)


def _busy(path: Path) -> PumpsError:
    return PumpsError(
        f"{path} is being written by another pumps.", "Wait until it has finished, or give another output."
    )
