"""Stand-ins for what Windows has and has not."""

from __future__ import annotations

import errno
import fcntl
import os
from types import SimpleNamespace
from typing import Any

import pytest

from data_schemas import disk, write_lock


class StandInMsvcrt(SimpleNamespace):
    """`msvcrt.locking`: locks by file, in this process, refused as Windows refuses them."""

    LK_NBLCK, LK_UNLCK = 2, 0

    def __init__(self) -> None:
        super().__init__(held=set())

    def locking(self, descriptor: int, mode: int, count: int) -> None:
        file = os.fstat(descriptor).st_ino
        if mode == self.LK_UNLCK:
            self.held.remove(file)
        elif file in self.held:
            raise PermissionError(errno.EACCES, "Permission denied")
        else:
            self.held.add(file)


def as_on_windows(monkeypatch: pytest.MonkeyPatch) -> StandInMsvcrt:
    """No fcntl, no fchmod; folders cannot be opened, and only what is open for writing can be flushed."""
    stand_in = StandInMsvcrt()
    monkeypatch.setattr(write_lock, "fcntl", None)
    monkeypatch.setattr(write_lock, "msvcrt", stand_in)
    monkeypatch.setattr(disk, "_FLUSHED_AS", os.O_RDWR)
    monkeypatch.delattr(os, "fchmod")
    flush, unlink, opening = os.fsync, os.unlink, os.open

    def fsync(descriptor: int) -> None:
        if fcntl.fcntl(descriptor, fcntl.F_GETFL) & os.O_ACCMODE == os.O_RDONLY:
            raise OSError(errno.EBADF, "Bad file descriptor")
        flush(descriptor)

    def remove(path: Any, **options: Any) -> None:
        if os.lstat(path).st_ino in stand_in.held:
            raise PermissionError(errno.EACCES, "The file is in use", str(path))
        unlink(path, **options)

    def opened(path: Any, flags: int, *more: Any, **options: Any) -> int:
        if not options and os.path.isdir(path):
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return opening(path, flags, *more, **options)

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(os, "unlink", remove)
    monkeypatch.setattr(os, "open", opened)
    return stand_in
