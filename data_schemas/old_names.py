"""Old names that still work for one more minor version: each is told once in a process."""

from __future__ import annotations

import warnings

_told: set[tuple[str, str]] = set()


class OldName(DeprecationWarning):
    """An old name was used. The command line prints it on stderr; in Python it is a warning."""


def tell_old_name(old: str, new: str, *, stacklevel: int = 2) -> None:
    """Warn once in this process that `old` is now `new`.

    Args:
        stacklevel: as for warnings.warn; 2 blames the caller's caller.
    """
    if (old, new) not in _told:
        _told.add((old, new))
        warnings.warn(old_name_told(old, new), OldName, stacklevel=stacklevel + 1)


def old_name_told(old: str, new: str) -> str:
    """The sentence that a user reads."""
    return f"{old} is now {new}; the old name goes in the next minor version."
