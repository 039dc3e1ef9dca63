"""The chosen folder: the only one that the page reads and writes."""

from __future__ import annotations

import os
from pathlib import Path

from data_schemas.errors import InputError, UsageError
from data_schemas.own_folders import make_own_folder
from stages.shared.file_names import is_file_name
from stages.shared.formats.archives import archive_and_member, archive_suffix, members_of
from stages.shared.formats.readers import AUTO, suffixes_of
from stages.shared.formats.writers import SUFFIXES

SESSIONS = ".pumps-studio"  # the folder in it that holds the sessions
_MOST_FILES = 500  # listed
_DEEPEST = 4  # folders below the chosen one that are listed


class Folder:
    """A folder, and names in it that cannot lead out of it."""

    def __init__(self, path: Path) -> None:
        self.path = path.resolve()
        if not self.path.is_dir():
            raise InputError(f"{path} is no folder.", "Name an existing one with --folder.")

    def recording(self, name: str) -> Path | str:
        """The path of a recording in the folder, or ARCHIVE!MEMBER of an archive in it.

        Args:
            name: relative to the folder, with `/` between its parts.

        Raises: InputError for a name that leads out of the folder, by links too, or to no file.
        """
        archive, member = archive_and_member(str(self.path / name))
        path = self._inside(archive or name)
        if not path.is_file():
            raise InputError(f"{name} is not in the folder of the studio.", "Choose a file of the list.")
        return f"{path}!{member}" if archive else path

    def new_file(self, name: str, overwrite: bool) -> Path:
        """Where a file of this name is written, directly in the folder.

        Raises: UsageError for a name that is no plain file name, has a suffix that pumps does not write, or is
            taken by a file that may not be replaced.
        """
        suffix = Path(name).suffix.lower()
        if not is_file_name(name) or name.startswith("-") or suffix not in (*SUFFIXES.values(), ".json", ".sh"):
            raise UsageError(
                f"{name!r} cannot be the name of a saved file.",
                f"Use letters and one of {', '.join(SUFFIXES.values())}.",
            )
        path = self.path / name
        if os.path.lexists(path) and (not overwrite or path.is_symlink() or not path.is_file()):
            raise UsageError(f"{name} exists.", "Choose another name, or replace it.")
        return path

    def recordings(self) -> list[str]:
        """Names of files that may be recordings, sorted, at most `_MOST_FILES`; in archives ARCHIVE!MEMBER."""
        wanted = tuple(suffixes_of(AUTO))
        found: list[str] = []
        for root, folders, files in os.walk(self.path):
            here = Path(root).relative_to(self.path)
            folders[:] = sorted(each for each in folders if not each.startswith(".") and _is_unicode(each))
            if len(here.parts) >= _DEEPEST:
                folders.clear()
            for name in sorted(filter(_is_unicode, files)):
                relative = (here / name).as_posix()
                if len(found) >= _MOST_FILES:
                    return found
                if name.lower().endswith(wanted):
                    found.append(relative)
                elif archive_suffix(name):
                    found += [f"{relative}!{each}" for each in self._members(relative)]
        return found[:_MOST_FILES]

    def sessions(self) -> Path:
        """The folder of the sessions, made where it is not there."""
        path = self.path / SESSIONS
        make_own_folder(path)
        return path

    def _members(self, archive: str) -> list[str]:
        try:
            path = self._inside(archive)
            return recordings_of_archive(path) if path.is_file() else []  # reading a pipe would wait for its writer
        except InputError:
            return []  # damaged

    def _inside(self, name: str) -> Path:
        try:
            path = (self.path / name).resolve()
        except (OSError, ValueError, RuntimeError):
            path = Path("/")
        if not path.is_relative_to(self.path):
            raise InputError(f"{name} leads out of the folder of the studio.", "Choose a file of the list.")
        return path


def recordings_of_archive(path: Path) -> list[str]:
    """Names of members of an archive that may be recordings, sorted. Raises InputError if it is damaged."""
    wanted = tuple(suffixes_of(AUTO))
    names = (each.name for each in members_of(str(path)))
    return sorted(name for name in names if name.lower().endswith(wanted) and _is_unicode(name))[:_MOST_FILES]


def _is_unicode(name: str) -> bool:
    """Whether a name can be sent to the page: the bytes of a name on the disk may be no UTF-8."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True
