"""One writer at a time for each artefact."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from data_schemas.errors import PumpsError

try:
    import fcntl
except ImportError:  # this system has no such locks: two writers are not prevented
    fcntl = None

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
                with suppress(OSError):
                    (path / LOCK_NAME).unlink()
                os.close(descriptor)
    finally:
        with _held_guard:
            _held.discard(key)


def _take(path: Path) -> int | None:
    if fcntl is None:
        return None
    while True:
        try:
            descriptor = os.open(path / LOCK_NAME, _LOCK_FLAGS, 0o666)
        except OSError as error:
            raise PumpsError(f"{path} cannot be written: {error.strerror}.") from None
        try:
            # A record lock, which worker processes forked by the writer do not inherit.
            fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
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


def _busy(path: Path) -> PumpsError:
    return PumpsError(
        f"{path} is being written by another pumps.", "Wait until it has finished, or give another output."
    )
