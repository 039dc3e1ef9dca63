"""Folders among the sessions that hold files while a request is answered."""

from __future__ import annotations

import secrets
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from data_schemas.own_folders import make_own_folder, remove_own_folder

_SCRATCH = ".scratch-"
_LEFT_S = 600.0  # a request takes seconds; a folder that is older was left by a studio that was ended


@contextmanager
def scratch_folder(sessions: Path) -> Iterator[Path]:
    """A new folder in that of the sessions, removed at the end. Those that an ended studio left are removed first."""
    remove_left(sessions)
    held = sessions / f"{_SCRATCH}{secrets.token_hex(8)}"
    make_own_folder(held)
    try:
        yield held
    finally:
        remove_own_folder(held)


def remove_left(sessions: Path) -> None:
    """Remove the folders that a studio left when it was ended."""
    for each in sessions.glob(f"{_SCRATCH}*"):
        with suppress(OSError):
            if time.time() - each.stat().st_mtime > _LEFT_S:
                remove_own_folder(each)
