"""Folders that pumps makes beside or inside its outputs, and may remove: each holds a marker file.

A folder without the marker is a person's own, whatever its name, and is never removed or replaced.
"""

from __future__ import annotations

import os
import shutil
from contextlib import suppress
from pathlib import Path

from data_schemas.errors import UsageError

MARKER_NAME = ".made-by-pumps"
_MARKER_TEXT = "pumps made this folder and may remove it with everything in it.\n"


def make_own_folder(path: Path) -> None:
    """Make a folder with its parents and mark it, unless it is a marked one already.

    Raises:
        UsageError: something that pumps did not make has this name; it is left unchanged.
        OSError: the disk refuses.
    """
    if not is_own_folder(path):
        refuse_unmarked(path)
        path.mkdir(parents=True, exist_ok=True)
        mark_own_folder(path)


def mark_own_folder(path: Path) -> None:
    """Mark a folder that is known to be pumps' own. Raises OSError if the disk refuses."""
    (path / MARKER_NAME).write_text(_MARKER_TEXT, encoding="utf-8")


def is_own_folder(path: Path) -> bool:
    """Whether `path` is a folder that pumps made."""
    marker = path / MARKER_NAME
    return path.is_dir() and not path.is_symlink() and marker.is_file() and not marker.is_symlink()


def refuse_unmarked(path: Path) -> None:
    """Raise UsageError if `path` exists and pumps did not make it. An empty folder passes: nothing can be lost."""
    if not os.path.lexists(path) or is_own_folder(path) or _is_empty_folder(path):
        return
    raise UsageError(
        f"{path} has a name that pumps uses for its own folders, but pumps did not make it.",
        "Move it to another place, delete it if it holds nothing you need, or give another output.",
    )


def remove_own_folder(path: Path) -> None:
    """Remove a marked or empty folder; anything else is left unchanged. What cannot be removed is left too.

    The marker goes last, so that a folder whose removal was interrupted is still known as pumps' own.
    """
    if is_own_folder(path):
        remove_folder(path)
    elif _is_empty_folder(path):
        with suppress(OSError):
            path.rmdir()


def remove_folder(path: Path) -> None:
    """Remove a folder that is known to be pumps' own, its marker last. What cannot be removed is left."""
    with suppress(OSError):
        for entry in list(path.iterdir()):
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry, ignore_errors=True)
            elif entry.name != MARKER_NAME:
                with suppress(OSError):
                    entry.unlink()
        (path / MARKER_NAME).unlink(missing_ok=True)
        path.rmdir()


def _is_empty_folder(path: Path) -> bool:
    try:
        return not path.is_symlink() and path.is_dir() and next(path.iterdir(), None) is None
    except OSError:
        return False
