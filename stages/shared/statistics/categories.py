"""Categories of clips by patterns of their sources, and other NAME=VALUE settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatch

from data_schemas.clips import ClipRow
from data_schemas.errors import UsageError
from stages.shared.statistics.archives import archive_of


def named(flag: str, texts: Sequence[str], taken: Sequence[str] = ()) -> dict[str, str]:
    """Names and values, in order. Raises UsageError for one that is not NAME=VALUE, or a name that comes twice."""
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (name and equals and value):
            raise UsageError(f"--{flag} {text!r} is not NAME=VALUE.", f"Write for instance --{flag} mine=runs/mine.")
        if name in found or name in taken:
            raise UsageError(f"--{flag} {text!r} has a name that is taken.", f"Give another: --{flag} NAME={value}.")
        found[name] = value
    return found


def category_of(row: ClipRow, patterns: Mapping[str, str]) -> str | None:
    """The first category whose pattern the clip's source matches, None if there is none; the clip's archive if no
    categories are given."""
    if not patterns:
        return archive_of(row)
    source = row.source.replace("\\", "/")
    return next((name for name, pattern in patterns.items() if fnmatch(source, pattern)), None)
