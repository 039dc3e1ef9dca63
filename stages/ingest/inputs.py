"""The inputs that an ingested artefact records: of each file and folder given, a digest of what was read of it."""

from __future__ import annotations

import glob
import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path

from data_schemas.manifest import sha256_of_file
from data_schemas.sources import digest_of_source
from stages.ingest.config import Config
from stages.shared.formats.archives import archive_and_member
from stages.shared.formats.readers import rig_suffixes
from stages.shared.formats.splits import SPLITS_NAME

_SMALL_BYTES = 16 << 20


def given_files(config: Config) -> list[Path]:
    """Files that the settings name beside the recordings: maps of skeletons, and the file of splits."""
    paths = list(config.skeleton_map)
    if config.splits:
        return [*paths, config.splits]
    folders = {path.parent for path in _given(config.sources) if path.is_file()}
    return [*paths, *sorted(path for folder in folders if (path := folder / SPLITS_NAME).is_file())]


def digests_of_read(config: Config, read: Iterable[tuple[str, str]]) -> list[tuple[Path, str, str]]:
    """Path, kind ("file" or "folder") and digest of every file and folder that the sources name.

    The digest of a file is its sha256; that of a folder covers the relative names and bytes of the recordings,
    archives and rigs that lie in it. What lies beside them is not read, and what could not be read has no digest.

    Args:
        read: name of each source ("archive.zip!member" or a path) and the sha256 of its bytes, "" if it was not read.
    """
    loose = {name: sha256 for name, sha256 in read if sha256}
    archives = {archive_and_member(name)[0] for name in loose} - {""}
    found: list[tuple[Path, str, str]] = []
    for path in _given(config.sources):
        if path.is_dir():
            found.append((path, "folder", _digest_of_folder(path, loose, archives)))
        elif str(path) in loose:
            found.append((path, "file", loose[str(path)]))
        elif str(path) in archives:
            found.append((path, *digest_of_source(path)))
    return found


def _digest_of_folder(folder: Path, loose: dict[str, str], archives: set[str]) -> str:
    total = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        sha256 = loose.get(str(path)) or (_sha256_if_read(path) if _counts(path, archives) else "")
        if sha256:
            total.update(f"{path.relative_to(folder).as_posix()}\0{sha256}\n".encode(errors="surrogateescape"))
    return total.hexdigest()


def _counts(path: Path, archives: set[str]) -> bool:
    """Whether a file that is not itself a recording is read: an archive of them, or a rig or sidecar beside them."""
    if str(path) in archives:
        return True
    return path.suffix.lower() in (*rig_suffixes(), ".json") and path.is_file() and path.stat().st_size < _SMALL_BYTES


def _sha256_if_read(path: Path) -> str:
    try:
        return sha256_of_file(path)
    except OSError:
        return ""


def _given(sources: Sequence[str]) -> list[Path]:
    """The files and folders on the disk that the sources name, each once."""
    paths: list[Path] = []
    for text in sources:
        path = Path(text)
        if path.exists():
            paths.append(path)
        elif glob.has_magic(text):
            paths += [Path(match) for match in sorted(glob.glob(text, recursive=True)) if Path(match).is_file()]
        elif archive := archive_and_member(text)[0]:
            paths.append(Path(archive))
    return list(dict.fromkeys(paths))
