"""Where recordings come from: files, folders, globs and zip archives, whose members are read one by one in memory.

Nothing is ever unpacked to the disk; members whose names climb out of their archive, or that would fill the memory,
are refused.
"""

from __future__ import annotations

import glob
import os
import zipfile
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path, PurePosixPath

from data_schemas.errors import InputError

MAX_FILE_BYTES = 1 << 30
MAX_RATIO = 300  # text of numbers packs 3 to 10 times; a bomb a thousand times and more
_RATIO_COUNTS_FROM = 16 << 20


@dataclass(frozen=True)
class Source:
    """One recording.

    name:    what reports call it: "path/archive.zip!member", or the file's path.
    archive: the zip archive's path, or "" for a plain file.
    member:  its name inside the archive, or relative to the folder that was given.
    size:    bytes, unpacked.
    """

    name: str
    archive: str
    member: str
    size: int

    @property
    def data_set(self) -> str:
        """The name of the archive file or of the folder that holds the file, for example "cmu-dance.zip"."""
        if self.archive:
            return Path(self.archive).name
        inside = len(PurePosixPath(self.member).parts)
        return Path(os.path.abspath(self.name)).parents[inside - 1].name

    def read(self) -> bytes:
        """The recording's bytes. Raises InputError where it cannot be read or is damaged."""
        return _read_member(self) if self.archive else _read_file(self)


def source_named(name: str) -> Source:
    """The source with the given `Source.name`. Raises InputError where it is not there."""
    archive, mark, member = name.partition("!")
    if mark and archive.lower().endswith(".zip"):
        for source in _sources_in_zip(archive, (PurePosixPath(member).suffix.lower(),)):
            if source.member == member:
                return source
        raise InputError(f"{archive} has no member '{member}'.")
    return _plain_file(Path(name), Path(name).name)


def find_sources(sources: Iterable[str], suffixes: tuple[str, ...] = (".bvh",)) -> list[Source]:
    """All recordings that the given files, folders, globs and zip archives hold, each once, sorted within each.

    Args:
        suffixes: of recordings, lower case. A file named outright is taken whatever its suffix.
    Raises: InputError where a source names nothing, or an archive is damaged or hostile.
    """
    found: dict[str, Source] = {}
    for text in sources:
        here = list(_expand(str(text), suffixes))
        if not here:
            raise InputError(f"{text} holds no recordings ({', '.join(suffixes)}).", "Check the path.")
        for source in here:
            found.setdefault(source.name, source)
    return list(found.values())


def _expand(text: str, suffixes: tuple[str, ...]) -> list[Source]:
    path = Path(text)
    if path.is_dir():
        inside = [p for p in sorted(path.rglob("*")) if p.suffix.lower() in (*suffixes, ".zip") and p.is_file()]
        return [source for p in inside for source in _one(p, p.relative_to(path).as_posix(), suffixes)]
    if path.exists():
        return _one(path, path.name, suffixes)
    if glob.has_magic(text):
        matches = [Path(match) for match in sorted(glob.glob(text, recursive=True))]
        if not matches:
            raise InputError(
                f"No file matches {text}.", "Check the pattern; quote it, so that the shell leaves it alone."
            )
        files = [match for match in matches if match.is_file()]
        return [source for match in files for source in _one(match, match.name, suffixes)]
    if "!" in text:
        return [source_named(text)]
    raise InputError(f"{text} does not exist.", "Check the path.")


def _one(path: Path, member: str, suffixes: tuple[str, ...]) -> list[Source]:
    if path.suffix.lower() == ".zip":
        return _sources_in_zip(str(path), suffixes)
    return [_plain_file(path, member)]


def _plain_file(path: Path, member: str) -> Source:
    try:
        size = path.stat().st_size
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.", "Check the path.") from None
    return Source(str(path), "", member, size)


def _sources_in_zip(archive: str, suffixes: tuple[str, ...]) -> list[Source]:
    out = []
    for info in _open_zip(archive).infolist():
        name = info.filename.replace("\\", "/")
        if info.is_dir() or PurePosixPath(name).suffix.lower() not in suffixes or "__MACOSX" in name:
            continue
        if name.startswith("/") or ":" in name.split("/")[0] or ".." in name.split("/"):
            raise InputError(f"{archive} has a member whose name climbs out of it: '{name[:100]}'.")
        packed = max(info.compress_size, 1)
        if info.file_size > MAX_FILE_BYTES or (
            info.file_size > _RATIO_COUNTS_FROM and info.file_size > MAX_RATIO * packed
        ):
            raise InputError(
                f"{archive} has a member '{name[:100]}' that would unpack to {info.file_size / 1e6:.0f} MB.",
                "That is no recording; take it out of the archive.",
            )
        out.append(Source(f"{archive}!{info.filename}", archive, info.filename, info.file_size))
    return sorted(out, key=lambda source: source.member)


@lru_cache(maxsize=8)
def _cached_zip(archive: str, stamp: tuple[int, int]) -> zipfile.ZipFile:
    return zipfile.ZipFile(archive)


def _open_zip(archive: str) -> zipfile.ZipFile:
    """The archive, opened once in each process as long as the file stays the same."""
    try:
        state = os.stat(archive)
        return _cached_zip(archive, (state.st_mtime_ns, state.st_size))
    except zipfile.BadZipFile:
        raise InputError(f"{archive} is no zip archive or is damaged.", "Fetch it again.") from None
    except OSError as error:
        raise InputError(f"{archive} cannot be read: {error.strerror}.", "Check the path.") from None


def _read_member(source: Source) -> bytes:
    try:
        with _open_zip(source.archive).open(source.member) as file:
            # The directory of a hostile archive may understate the size; read no more than it says, and one byte.
            data = file.read(source.size + 1)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, KeyError, OSError) as error:
        reason = "it is encrypted" if "encrypted" in str(error) else "its data are damaged"
        raise InputError(f"{source.name} cannot be read: {reason}.", "Fetch the archive again.") from None
    if len(data) != source.size:
        raise InputError(f"{source.name} is {len(data)} bytes or more where the archive says {source.size}.")
    return data


def _read_file(source: Source) -> bytes:
    if source.size > MAX_FILE_BYTES:
        raise InputError(f"{source.name} has {source.size / 1e6:.0f} MB, which is no recording.")
    try:
        return Path(source.name).read_bytes()
    except OSError as error:
        raise InputError(f"{source.name} cannot be read: {error.strerror}.", "Check the path.") from None
