"""Names of clips in artefacts, from the archives, folders and files that hold them."""

from __future__ import annotations

import re
from pathlib import PurePosixPath

from stages.shared.formats.archives import archive_suffix
from stages.shared.formats.sources import Source


class ClipNames:
    """Names for clips from their archive and member: unique, and safe as a part of a path."""

    def __init__(self) -> None:
        self._taken: set[str] = set()

    def name(self, source: Source, part: str = "") -> str:
        """The name of a source's clip, or of one part of it."""
        stem = PurePosixPath(source.member.replace("\\", "/")).with_suffix("").as_posix() + (
            f".{part}" if part else ""
        )
        data_set = source.data_set.removesuffix(archive_suffix(source.data_set))
        path = stem if stem.split("/")[0] == data_set else f"{data_set}/{stem}"
        base = re.sub(r"[^A-Za-z0-9_.-]+", "_", path.replace("/", ".")).strip("._") or "clip"
        name, copy = base[:200], 1
        while name.lower() in self._taken:
            copy += 1
            name = f"{base[:190]}-{copy}"
        self._taken.add(name.lower())
        return name
