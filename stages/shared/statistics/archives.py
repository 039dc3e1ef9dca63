"""The data set that a clip is from."""

from __future__ import annotations

from data_schemas.clips import ClipRow


def archive_of(row: ClipRow) -> str:
    """The data set that a clip is from: its archive, or the folder of a loose file."""
    if row.archive is not None:
        return row.archive.removesuffix(".zip")
    source = row.source.replace("\\", "/")
    folder = source.rsplit("/", 1)[0] if "/" in source else ""
    return folder.rsplit("/", 1)[-1] or "files"
