"""The sources of recordings: files, folders, globs and archives, whose members are read one by one in memory."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import NoReturn

from data_schemas.errors import InputError
from stages.shared.formats.archives import (
    ARCHIVE_SUFFIXES,
    MAX_FILE_BYTES,
    Member,
    archive_and_member,
    archive_suffix,
    members_of,
    read_member,
)
from stages.shared.formats.unread_formats import UNREAD

_MAX_NEIGHBOURS = 100_000


@dataclass(frozen=True)
class Source:
    """One recording.

    name:    its name in reports: "path/archive.zip!member", or the file's path.
    archive: the archive's path, or "" for a plain file.
    member:  its name inside the archive, or relative to the given folder.
    size:    bytes, unpacked.
    offset:  where its bytes begin in an unpacked tar archive, else -1.
    named:   True if the user named this file itself, not a folder, pattern or archive that holds it.
    fault:   why it cannot be read, if that is known already: `read` raises it.
    """

    name: str
    archive: str
    member: str
    size: int
    offset: int = -1
    named: bool = field(default=False, compare=False)
    fault: InputError | None = field(default=None, compare=False)

    @property
    def data_set(self) -> str:
        """The name of the archive file or of the folder that holds the file, for example "cmu-dance.zip"."""
        if self.archive:
            return Path(self.archive).name
        inside = len(PurePosixPath(self.member).parts)
        return Path(os.path.abspath(self.name)).parents[inside - 1].name

    @property
    def suffix(self) -> str:
        """The end of the file's name, lower case, with its dot."""
        return PurePosixPath(self.member.replace("\\", "/")).suffix.lower()

    def read(self) -> bytes:
        """The recording's bytes. Raises InputError if it cannot be read or is damaged."""
        if self.fault is not None:
            raise InputError(self.fault.message, self.fault.hint)
        if self.archive:
            return read_member(self.archive, Member(self.member, self.size, self.offset))
        return _read_file(self)


def source_named(name: str) -> Source:
    """The source with the given `Source.name`. Raises InputError if it does not exist."""
    archive, member = archive_and_member(name)
    if archive:
        for source in _in_archive(archive):
            if source.member == member:
                return Source(source.name, archive, member, source.size, source.offset, named=True)
        raise InputError(f"{archive} has no member '{member}'.")
    return _plain_file(Path(name), Path(name).name, named=True)


def find_sources(
    sources: Iterable[str], suffixes: tuple[str, ...] = (".bvh",), *, keep_bad: bool = False
) -> list[Source]:
    """All recordings in the given files, folders, globs and archives, each once; those of one source are sorted.

    Members of a tar archive are in the archive's own order, which is the fastest to read.

    Args:
        suffixes: of recordings, lower case. A file that is named itself may have any suffix.
        keep_bad: give an archive that is damaged or hostile, or a file that cannot be read, as one source with its
            `fault`, instead of raising it.
    Raises: InputError if a source holds no recordings, or an archive is damaged or hostile.
    """
    found: dict[str, Source] = {}
    for text in sources:
        here = _expand(str(text), suffixes, keep_bad)
        if not here:
            _refuse_without_recordings(str(text), suffixes)
        for source in here:
            found.setdefault(source.name, source)
    return list(found.values())


def _refuse_without_recordings(text: str, suffixes: tuple[str, ...]) -> NoReturn:
    """Raise InputError for a folder, glob or archive without recordings.

    If it holds a file of a format that pumps knows and does not read, the error names the file and how to convert it.
    """
    unread = {suffix: each for each in UNREAD for suffix in each.suffixes}
    for source in _expand(text, tuple(unread), keep_bad=True):
        found = unread.get(PurePosixPath(source.member).suffix.lower())
        if found is not None and not source.fault:
            shown = f"{text} holds no recordings that pumps reads; {source.member} is {found.what}."
            raise InputError(shown, found.hint)
    raise InputError(f"{text} holds no recordings ({', '.join(suffixes)}).", "Check the path.")


def beside(source: Source, suffix: str) -> list[Source]:
    """Files with this suffix in the folder, on the disk or in the archive, that holds a recording."""
    if source.archive:
        folder = PurePosixPath(source.member).parent
        return [other for other in _by_suffix(source.archive, suffix) if PurePosixPath(other.member).parent == folder]
    return list(_on_disk(str(Path(source.name).parent), suffix))


def above(source: Source, suffix: str) -> list[Source]:
    """Files with this suffix in the nearest folder above a recording's that has any; in an archive else anywhere."""
    if not source.archive:
        return list(_on_disk(str(Path(os.path.abspath(source.name)).parent.parent), suffix))
    found = _by_suffix(source.archive, suffix)
    for folder in PurePosixPath(source.member).parents[1:]:
        if nearest := [other for other in found if PurePosixPath(other.member).parent == folder]:
            return nearest
    return list(found)


@lru_cache(maxsize=16)
def _by_suffix(archive: str, suffix: str) -> tuple[Source, ...]:
    return tuple(source for source in _in_archive(archive) if source.suffix == suffix)


@lru_cache(maxsize=256)
def _on_disk(folder: str, suffix: str) -> tuple[Source, ...]:
    found = []
    with os.scandir(folder) as entries:
        for entry, _ in zip(entries, range(_MAX_NEIGHBOURS), strict=False):
            if entry.name.lower().endswith(suffix) and entry.is_file():
                found.append(_plain_file(Path(entry.path), entry.name))
    return tuple(sorted(found, key=lambda source: source.name))


def _expand(text: str, suffixes: tuple[str, ...], keep_bad: bool) -> list[Source]:
    path = Path(text)
    if path.is_dir():
        wanted = (*suffixes, *ARCHIVE_SUFFIXES)
        inside = [p for p in sorted(path.rglob("*")) if p.name.lower().endswith(wanted) and p.is_file()]
        return [source for p in inside for source in _one(p, p.relative_to(path).as_posix(), suffixes, keep_bad)]
    if path.exists():
        return _one(path, path.name, suffixes, keep_bad, named=True)
    archive, _ = archive_and_member(text)
    if archive and Path(archive).is_file():
        return [source_named(text)]
    if glob.has_magic(text):
        matches = [Path(match) for match in sorted(glob.glob(text, recursive=True))]
        if not matches:
            raise InputError(
                f"No file matches {text}.", "Check the pattern; quote it, so that the shell leaves it alone."
            )
        files = [match for match in matches if match.is_file()]
        return [source for match in files for source in _one(match, match.name, suffixes, keep_bad)]
    if archive:
        return [source_named(text)]
    raise InputError(f"{text} does not exist.", "Check the path.")


def _one(
    path: Path, member: str, suffixes: tuple[str, ...], keep_bad: bool = False, named: bool = False
) -> list[Source]:
    try:
        if archive_suffix(path.name):
            return [source for source in _in_archive(str(path)) if source.suffix in suffixes]
        return [_plain_file(path, member, named)]
    except InputError as error:
        if not keep_bad:
            raise
        return [Source(str(path), "", member, 0, named=named, fault=error)]


def _plain_file(path: Path, member: str, named: bool = False) -> Source:
    try:
        size = path.stat().st_size
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.", "Check the path.") from None
    return Source(str(path), "", member, size, named=named)


def _in_archive(archive: str) -> list[Source]:
    return [
        Source(f"{archive}!{member.name}", archive, member.name, member.size, member.offset)
        for member in members_of(archive)
    ]


def _read_file(source: Source) -> bytes:
    if source.size > MAX_FILE_BYTES:
        raise InputError(f"{source.name} has {source.size / 1e6:.0f} MB, which is not a recording.")
    try:
        return Path(source.name).read_bytes()
    except OSError as error:
        raise InputError(f"{source.name} cannot be read: {error.strerror}.", "Check the path.") from None
