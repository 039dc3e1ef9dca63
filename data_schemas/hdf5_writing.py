"""New HDF5 files whose disk may be full: the failure is one OSError, and the library never sees it.

The HDF5 library flushes its caches when a file is closed, also after a failed write, and crashes the process if the
disk is full then. So the bytes go through a Python object. After the first failed write, that object keeps what else
the library writes in memory, which is a few megabytes of caches, and the writer raises the disk's own error.
"""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import Any

import h5py


class NewFile(io.RawIOBase):
    """The bytes of a new file, read and written in any order, as HDF5 does it.

    Args:
        path: a file that does not exist.

    Raises: OSError if it cannot be made.
    """

    def __init__(self, path: str | os.PathLike[str]):
        self._handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666)
        self._at = self._end = 0
        self._fault: OSError | None = None
        self._unwritten: list[tuple[int, bytes]] = []

    def check(self) -> None:
        """Raise the OSError of the first write that the disk refused, if there was one."""
        if self._fault is not None:
            raise self._fault

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._at

    def seek(self, offset: int, whence: int = 0) -> int:
        self._at = offset + (0, self._at, self._end)[whence]
        return self._at

    def readinto(self, buffer: Any) -> int:
        view = memoryview(buffer).cast("B")
        count = max(0, min(len(view), self._end - self._at))
        os.lseek(self._handle, self._at, os.SEEK_SET)  # Windows has no pread and pwrite
        view[:count] = os.read(self._handle, count).ljust(count, b"\0")
        for start, data in self._unwritten:
            first, last = max(start, self._at), min(start + len(data), self._at + count)
            if first < last:
                view[first - self._at : last - self._at] = data[first - start : last - start]
        self._at += count
        return count

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        done = 0
        try:
            os.lseek(self._handle, self._at, os.SEEK_SET)
            while self._fault is None and done < len(view):
                done += os.write(self._handle, view[done:])
        except OSError as error:
            self._fault = error
        if done < len(view):
            self._unwritten.append((self._at + done, bytes(view[done:])))
        self._at += len(view)
        self._end = max(self._end, self._at)
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        size = self._at if size is None else size
        if self._fault is None:
            try:
                os.ftruncate(self._handle, size)
            except OSError as error:
                self._fault = error
        self._end = size
        return size

    def flush(self) -> None:
        pass  # `data_schemas.artefact` flushes the finished file

    def close(self) -> None:
        if not self.closed:
            try:
                os.close(self._handle)
            except OSError as error:  # a disk over a network may refuse as late as here
                self._fault = self._fault or error
        super().close()


class NewHdf5:
    """A new HDF5 file. `file` is the open h5py file; `close` closes it.

    Args:
        path:   a file that does not exist.
        libver: as for h5py.File.

    Raises: OSError if it cannot be made.
    """

    def __init__(self, path: Path, *, libver: str | None = None):
        self._bytes = NewFile(path)
        self.file = h5py.File(self._bytes, "w", libver=libver)

    def check(self) -> None:
        """Raise OSError if the disk refused a write; call it after each array, so that work stops there."""
        self._bytes.check()

    def close(self) -> None:
        """Close the file, which writes what is left. Raises OSError if the disk refused any write."""
        self.discard()
        self._bytes.check()

    def discard(self) -> None:
        """Close a file that is not wanted any more, whether or not all of it could be written."""
        self.file.close()
        self._bytes.close()

    def __enter__(self) -> h5py.File:
        return self.file

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        if kind is None:
            self.close()
        else:
            self.discard()
