"""Archives of weights, sound and hostile."""

from __future__ import annotations

import hashlib
import io
import tarfile
import zipfile
from pathlib import Path


def tar_of(folder: Path, above: str = "") -> bytes:
    """A folder's files as a tar, below a folder of the archive."""
    return tar({f"{above}{path.relative_to(folder).as_posix()}": path.read_bytes() for path in _files(folder)})


def zip_of(folder: Path) -> bytes:
    """A folder's files as a zip."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in _files(folder):
            archive.write(path, path.relative_to(folder).as_posix())
    return out.getvalue()


def tar(files: dict[str, bytes], links: dict[str, str] | None = None) -> bytes:
    """A tar of these names and bytes, and of links to these targets before them."""
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w") as archive:
        for name, target in (links or {}).items():
            info = tarfile.TarInfo(name)
            info.type, info.linkname = tarfile.SYMTYPE, target
            archive.addfile(info)
        for name, data in files.items():
            info = tarfile.TarInfo(name)
            info.size = len(data)
            archive.addfile(info, io.BytesIO(data))
    return out.getvalue()


def files_of(folder: Path) -> dict[str, bytes]:
    """The files of a folder by their paths in it."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in _files(folder)}


def checksum_of(data: bytes) -> str:
    """As a registry states it."""
    return "sha256:" + hashlib.sha256(data).hexdigest()


def registry_of(data: bytes, licences: str = "test only", **changes: object) -> str:
    """A registry of one name, `walks`."""
    values = {"title": "Walks", "home": "https://example.org", "checksum": checksum_of(data)} | changes
    lines = [f'{name} = "{value}"' for name, value in values.items() if name != "bytes"]
    lines += [f"bytes = {changes.get('bytes', len(data))}", f'licences = ["{licences}"]']
    return "\n".join(["[walks]", *lines, ""])


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())
