"""The value of `--skeleton`: a rig for files that hold none."""

from __future__ import annotations

from stages.shared.formats.joint_lists import LISTS
from stages.shared.formats.sources import source_named


def rig_named(text: str) -> tuple[bytes, str]:
    """Bytes and name of a rig's file ("archive.zip!member" too), or no bytes and the name of one of `LISTS`.

    Raises: InputError if the file does not exist.
    """
    if text in LISTS:
        return b"", text
    source = source_named(text)
    return source.read(), source.name
