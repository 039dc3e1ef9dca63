"""Zip and tar archives, listed and read member by member in memory; nothing is ever unpacked to the disk.

A member is refused if its name leads out of the archive, or if it would fill the memory.
"""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import os
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO

from data_schemas.errors import InputError

MAX_FILE_BYTES = 1 << 30
MAX_RATIO = 40  # unpacked over packed bytes: 3 to 10 for numbers as text, 1000 for one number repeated
_RATIO_COUNTS_FROM = 16 << 20
_MAX_MEMBERS = 2_000_000

_TAR_SUFFIXES: dict[str, Callable[..., Any]] = {
    ".tar": open, ".tar.gz": gzip.open, ".tgz": gzip.open, ".tar.bz2": bz2.open, ".tbz2": bz2.open,
    ".tar.xz": lzma.open, ".txz": lzma.open,
}  # fmt: skip
ARCHIVE_SUFFIXES = (".zip", *_TAR_SUFFIXES)
_DAMAGED = (
    zipfile.BadZipFile, tarfile.TarError, zlib.error, lzma.LZMAError, gzip.BadGzipFile, EOFError, NotImplementedError,
    RuntimeError, LookupError, ValueError, OverflowError, OSError,
)  # fmt: skip


@dataclass(frozen=True)
class Member:
    """A file in an archive. offset: where its bytes begin in the unpacked tar; -1 in a zip."""

    name: str
    size: int
    offset: int


def archive_suffix(name: str) -> str:
    """The one of ARCHIVE_SUFFIXES that a file name ends in, or ""."""
    lower = name.lower()
    return next((suffix for suffix in ARCHIVE_SUFFIXES if lower.endswith(suffix)), "")


def archive_and_member(name: str) -> tuple[str, str]:
    """The archive and the member of a name ARCHIVE!MEMBER; ("", "") for one that names no member of an archive.

    Folders, files and members may have exclamation marks in their names: the archive is the first one that exists,
    and, if none does, the first part that has an archive's suffix.
    """
    if "!" not in name or os.path.exists(name):
        return "", ""
    ends = [at for at, letter in enumerate(name) if letter == "!" and archive_suffix(name[:at])]
    end = next((at for at in ends if Path(name[:at]).is_file()), ends[0] if ends else None)
    return ("", "") if end is None else (name[:end], name[end + 1 :])


def members_of(archive: str) -> tuple[Member, ...]:
    """All plain files of an archive, in the order that is fastest to read.

    Raises: InputError if the archive is damaged, or a member's name or size is hostile.
    """
    try:
        return _listed(archive, _stamp(archive))
    except OSError as error:
        raise InputError(f"{archive} cannot be read: {error.strerror or error}.", "Check the path.") from None


def read_member(archive: str, member: Member) -> bytes:
    """A member's bytes. Raises InputError if they are damaged, or their size is not the one in the archive's list."""
    name = f"{archive}!{member.name}"
    try:
        if member.offset >= 0:
            stream = _tar_stream(archive, _stamp(archive))
            stream.seek(member.offset)
            data = stream.read(member.size)
        else:
            with _zip(archive, _stamp(archive)).open(member.name) as file:
                # A hostile archive may list a size that is too small: read one byte more than that, and no further.
                data = file.read(member.size + 1)
    except _DAMAGED as error:
        reason = "it is encrypted" if "encrypted" in str(error) else "its data are damaged"
        raise InputError(f"{name} cannot be read: {reason}.", "Fetch the archive again.") from None
    if len(data) != member.size:
        raise InputError(
            f"{name} is {len(data)} bytes or more, but the archive lists {member.size}.", "Fetch the archive again."
        )
    return data


def _stamp(archive: str) -> tuple[int, int]:
    state = os.stat(archive)
    return state.st_mtime_ns, state.st_size


@lru_cache(maxsize=8)
def _listed(archive: str, stamp: tuple[int, int]) -> tuple[Member, ...]:
    """The members of an archive, read once per process unless the file changes."""
    is_zip = archive_suffix(archive) == ".zip"
    members = []
    try:
        for name, size, packed, offset in (_in_zip if is_zip else _in_tar)(archive, stamp):
            _check_member(archive, name, size, packed)
            members.append(Member(name, size, offset))
            if len(members) > _MAX_MEMBERS:
                raise InputError(f"{archive} has more than {_MAX_MEMBERS} members.")
    except (*_DAMAGED, RecursionError, MemoryError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        kind = "zip" if is_zip else "tar"
        raise InputError(f"{archive} is not a {kind} archive, or it is damaged.", "Fetch it again.") from None
    if is_zip:
        members.sort(key=lambda member: member.name)
    return tuple(members)


def _check_member(archive: str, name: str, size: int, packed: int) -> None:
    plain = name.replace("\\", "/")
    if plain.startswith("/") or ":" in plain.split("/")[0] or ".." in plain.split("/") or "\0" in plain:
        raise InputError(
            f"{archive} has a member whose name leads out of the archive: '{name[:100]}'.",
            "Take it out of the archive.",
        )
    if size > MAX_FILE_BYTES or (size > _RATIO_COUNTS_FROM and size > MAX_RATIO * max(packed, 1)):
        raise InputError(
            f"{archive} has a member '{name[:100]}' that would unpack to {size / 1e6:.0f} MB.",
            "Take it out of the archive; if it is a recording, give its file itself.",
        )


# --- zip ----------------------------------------------------------------------------------------


@lru_cache(maxsize=8)
def _zip(archive: str, stamp: tuple[int, int]) -> zipfile.ZipFile:
    return zipfile.ZipFile(archive)


def _in_zip(archive: str, stamp: tuple[int, int]) -> Iterator[tuple[str, int, int, int]]:
    for info in _zip(archive, stamp).infolist():
        if info.filename and not info.is_dir() and "__MACOSX" not in info.filename:
            yield info.filename, info.file_size, info.compress_size, -1


# --- tar ----------------------------------------------------------------------------------------


class _Unpacked(io.RawIOBase):
    """An archive's unpacked bytes.

    Reading forwards is cheap; seeking backwards unpacks again from the start. Unpacking stops at a size limit.
    """

    def __init__(self, archive: str):
        self._file: BinaryIO = _TAR_SUFFIXES[archive_suffix(archive)](archive, "rb")
        packed = os.path.getsize(archive)
        self._limit = packed if archive.lower().endswith(".tar") else max(_RATIO_COUNTS_FROM, MAX_RATIO * packed)
        self._archive = archive

    def close(self) -> None:
        if hasattr(self, "_file"):  # it was opened
            self._file.close()
        super().close()

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._file.tell()

    def seek(self, offset: int, whence: int = 0) -> int:
        if whence != 0 or offset < 0:
            raise ValueError("seek takes an offset of 0 or more from the start of the archive")
        self._check(offset)
        return self._file.seek(offset)

    def read(self, size: int = -1) -> bytes:
        if not 0 <= size <= MAX_FILE_BYTES:
            raise ValueError(f"cannot read {size} bytes: the size must be from 0 to {MAX_FILE_BYTES}")
        self._check(self._file.tell() + min(size, _RATIO_COUNTS_FROM))
        pieces = []
        while size > 0:  # in pieces, so that memory is taken only for bytes that are there
            piece = self._file.read(min(size, 1 << 20))
            if not piece:
                break
            pieces.append(piece)
            size -= len(piece)
            self._check(self._file.tell())
        return b"".join(pieces)

    def _check(self, place: int) -> None:
        if place > self._limit + _RATIO_COUNTS_FROM:
            raise InputError(
                f"{self._archive} would unpack to more than {self._limit / 1e6:.0f} MB, or ends before it should.",
                "That is not an archive of recordings, or it is damaged.",
            )


@lru_cache(maxsize=4)
def _tar_stream(archive: str, stamp: tuple[int, int]) -> _Unpacked:
    return _Unpacked(archive)


def _in_tar(archive: str, stamp: tuple[int, int]) -> Iterator[tuple[str, int, int, int]]:
    packed = os.path.getsize(archive)
    with _Unpacked(archive) as stream, tarfile.TarFile(fileobj=stream, mode="r", errorlevel=2) as tar:
        last = -1
        while (info := tar.next()) is not None:
            tar.members = []  # type: ignore[attr-defined]  # it would keep them all
            if info.offset <= last or info.size < 0:
                raise tarfile.ReadError("a member begins before the one before it ends")
            last = info.offset
            if info.issym() or info.islnk() or not info.isreg() or info.issparse():
                continue
            if "__MACOSX" not in info.name and not PurePosixPath(info.name).name.startswith("._"):
                yield info.name, info.size, packed, info.offset_data


def forget() -> None:
    """Close the archives that are kept open. Needed when a file changes within the clock's resolution."""
    for cached in (_listed, _zip, _tar_stream):
        cached.cache_clear()
