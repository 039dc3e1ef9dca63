"""Reading artefacts: the manifest, and opening an artefact.

An artefact is the folder that the user names. It holds `manifest.json` and one data folder, which is named after a
digest of its content and is recorded in the manifest:

    NAME/manifest.json
    NAME/data-1f0c.../motions.h5, clips.parquet

The manifest is replaced in one step, so a reader finds either the whole old artefact or the whole new one.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import stat
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeGuard, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from data_schemas.errors import InputError
from data_schemas.kinds import KINDS
from data_schemas.manifest_bounds import (
    MOST_FILES,
    MOST_INPUTS,
    MOST_LICENCES,
    Creator,
    InputPath,
    Licence,
    PlainName,
    PlainTree,
    Sha256,
    Version,
    is_plain_name,
    is_sha256,
)
from data_schemas.version import PUMPS_VERSION

MANIFEST_NAME = "manifest.json"
DATA_PREFIX = "data-"
MANIFEST_LIMIT_BYTES = 256 * 2**20  # far more than any real manifest; a hostile one must not fill the memory

MANIFEST_VERSION = 2  # 1: without `content` and `manifest_digest`, and `digest` is that of the files' bytes
_LONGEST_NAME = 1000

_DATA_FOLDER = re.compile(r"data-[0-9a-f]{16}(-[0-9]+)?")
_FILE_PART = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")

Result = TypeVar("Result")


class InputRef(BaseModel):
    """One input of an artefact.

    path:   its path relative to the artefact's own folder (so that a run folder can be moved as a whole).
    kind:   the artefact's kind, or "file" or "folder" for sources.
    digest: its digest when it was read.
    """

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)

    path: InputPath
    kind: PlainName
    digest: Sha256


class Manifest(BaseModel):
    """The content of `manifest.json`.

    kind, schema_version: these determine its reader.
    created_by: "pumps 0.1.0".
    stage:      the stage that wrote it; `config`: the whole config of that run.
    inputs:     the artefacts and files it was made from.
    data:       the name of the data folder beside the manifest.
    files:      relative file name -> sha256 of its bytes.
    content:    relative file name -> sha256 of its arrays, columns or settings (`data_schemas.content_digest`); files
                that hold none of their own are left out. {} in manifests of version 1.
    digest:     the digest of kind, version and content together. It depends on no time and no compression: the same
                inputs, settings and seed give the same digest. In manifests of version 1: of kind, version and files.
    licences:   of its own sources and of its inputs.
    summary:    facts that the stage reports, plain data.
    manifest_version: of the manifest itself; 1 where it is not stated.
    manifest_digest:  sha256 of all other fields, so that `verify` finds a change in any of them; "" in version 1.
    """

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)

    kind: PlainName
    schema_version: Version
    created_by: Creator
    stage: PlainName
    config: PlainTree
    inputs: list[InputRef] = Field(max_length=MOST_INPUTS)
    data: str
    files: dict[str, Sha256] = Field(max_length=MOST_FILES)
    digest: Sha256
    licences: list[Licence] = Field(max_length=MOST_LICENCES)
    summary: PlainTree
    content: dict[str, Sha256] = Field(default={}, max_length=MOST_FILES)
    manifest_version: Version = 1
    manifest_digest: str = ""

    @field_validator("data")
    @classmethod
    def _data_is_a_plain_name(cls, value: str) -> str:
        if not _DATA_FOLDER.fullmatch(value):
            raise ValueError("is not the name of a data folder")
        return value

    @field_validator("files", "content")
    @classmethod
    def _files_stay_inside(cls, value: dict[str, str]) -> dict[str, str]:
        for name in value:
            if len(name) > _LONGEST_NAME or not is_inner_name(name):
                raise ValueError(f"names {name[:200]!r}, which is not a plain path inside the artefact")
        return value

    @field_validator("manifest_digest")
    @classmethod
    def _digest_or_none(cls, value: str) -> str:
        if value and not is_sha256(value):
            raise ValueError("is not a sha256 of 64 hex digits")
        return value

    @property
    def expected_digest(self) -> str:
        """The digest that belongs to the kind, the version and the files' digests of this manifest."""
        if self.manifest_version < MANIFEST_VERSION:
            return digest_of_files(self.kind, self.schema_version, self.files)
        return digest_of(self.kind, self.schema_version, self.content)


@dataclass(frozen=True)
class Artefact:
    """An artefact on the disk: `path` as the user names it, `folder` with its data files, and the manifest."""

    path: Path
    folder: Path
    manifest: Manifest

    def file(self, name: str) -> Path:
        """Path of the data file `name`. Raises InputError if the manifest does not list it."""
        if name not in self.manifest.files:
            raise InputError(
                f"{self.path} ({self.manifest.kind}) has no file {name}.",
                f"It lists: {', '.join(self.manifest.files)}.",
            )
        return self.folder / name


def is_inner_name(name: str) -> bool:
    """Whether `name` is a relative path of plain parts, which cannot lead out of its folder."""
    return all(_FILE_PART.fullmatch(part) for part in name.split("/"))


def sha256_of_file(path: Path) -> str:
    """Hex sha256 of the file's bytes."""
    total = hashlib.sha256()
    with open(path, "rb") as file:
        while part := file.read(1 << 20):
            total.update(part)
    return total.hexdigest()


def digest_of(kind: str, schema_version: int, content: Mapping[str, str]) -> str:
    """Digest of an artefact: sha256 over its kind, its version, its files' names and the digests of their content."""
    return _sha256_of_json(["content", kind, schema_version, sorted(content.items())])


def digest_of_files(kind: str, schema_version: int, files: Mapping[str, str]) -> str:
    """Digest of an artefact whose manifest has version 1: of its files' bytes."""
    return _sha256_of_json([kind, schema_version, sorted(files.items())])


def digest_of_manifest(fields: Mapping[str, Any]) -> str:
    """sha256 of all fields of a manifest, as they stand in its JSON, except `manifest_digest`."""
    covered = {name: value for name, value in fields.items() if name != "manifest_digest"}
    return _sha256_of_json(covered)


def manifest_has_changed(folder: Path) -> bool:
    """Whether a manifest of version 2 differs from the one that was written. Raises InputError if it is not JSON."""
    raw = read_json(folder)
    return raw.get("manifest_digest") != digest_of_manifest(raw)


def _sha256_of_json(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def names_artefact(path: Path) -> bool:
    """Whether `open_artefact` would take this path for an artefact's folder or its `manifest.json`."""
    return (path / MANIFEST_NAME).is_file() or path.name == MANIFEST_NAME


def open_artefact(path: str | os.PathLike[str], kind: str | None = None) -> Artefact:
    """Open the artefact in the folder `path` (its `manifest.json` may be named instead).

    Checks the manifest, and that every file it lists exists; `verify` checks the files' bytes too.

    Args:
        path: the folder.
        kind: the kind it must be, or None for any.

    Raises:
        InputError: it is missing, not an artefact, of another kind, written by a newer pumps, or damaged.
    """
    folder = Path(path)
    if folder.name == MANIFEST_NAME and folder.is_file():
        folder = folder.parent
    # A writer may replace the manifest after it is read here and before its files are found: then read it again.
    seen: str | None = None
    while True:
        manifest = read_manifest(folder, kind)
        problem = _first_missing(folder, manifest)
        if problem is None:
            return Artefact(folder, folder / manifest.data, manifest)
        if manifest.data == seen:
            raise InputError(
                f"{folder} is damaged: {problem}", "Delete the folder and run the stage that made it again."
            )
        seen = manifest.data


def read_newest(artefact: Artefact | str | os.PathLike[str], kind: str, read: Callable[[Artefact], Result]) -> Result:
    """Read an artefact of `kind` with `read`. If it is given by path and is replaced meanwhile, it is read again.

    Raises:
        InputError: see `open_artefact` and `read`.
    """
    if isinstance(artefact, Artefact):
        return read(artefact if artefact.manifest.kind == kind else open_artefact(artefact.path, kind))
    while True:
        found = open_artefact(artefact, kind)
        try:
            return read(found)
        except InputError:
            # A writer may have replaced the artefact since its manifest was read: then the new one is read.
            if open_artefact(artefact, kind).manifest.data == found.manifest.data:
                raise


def read_manifest(folder: Path, kind: str | None = None) -> Manifest:
    """Read and check `folder`/manifest.json, but not the data. Raises InputError as `open_artefact` does."""
    raw = read_json(folder)
    found, version, form = raw.get("kind"), raw.get("schema_version"), raw.get("manifest_version", 1)
    if not isinstance(found, str) or not is_plain_name(found) or not _is_whole(version) or not _is_whole(form):
        raise InputError(
            f"{folder / MANIFEST_NAME} is not a manifest of a pumps artefact: it lacks kind and schema_version.",
            "Give the folder that a pumps stage wrote.",
        )
    if kind is not None and found != kind:
        raise InputError(
            f"{folder} holds a {found!r} artefact, but a {kind!r} artefact is needed here.", _kind_hint(kind)
        )
    newer_hint = f"Install the pumps that wrote it or a newer one ({_text(raw.get('created_by'))})."
    if found not in KINDS:
        raise InputError(
            f"{folder} is an artefact of kind {found!r}, which pumps {PUMPS_VERSION} cannot read.", newer_hint
        )
    if form > MANIFEST_VERSION:
        raise InputError(
            f"{folder} has a manifest of version {_text(form)}, and pumps {PUMPS_VERSION} reads versions up to "
            f"{MANIFEST_VERSION}.",
            newer_hint,
        )
    if version > KINDS[found].schema_version:
        raise InputError(
            f"{folder} is a {found!r} artefact of version {_text(version)}, and pumps {PUMPS_VERSION} reads versions "
            f"up to {KINDS[found].schema_version}.",
            newer_hint,
        )
    try:
        return Manifest.model_validate(raw)
    except ValidationError as error:
        faults = "; ".join(f"{'.'.join(map(str, e['loc']))}: {_text(e['msg'])}" for e in error.errors()[:5])
        raise InputError(
            f"{folder / MANIFEST_NAME} is damaged ({faults}).", "Run the stage that made it again."
        ) from None


def read_json(folder: Path) -> dict[str, Any]:
    """The fields of `folder`/manifest.json, not yet checked. Raises InputError if it is missing or not JSON."""
    path = folder / MANIFEST_NAME
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode) or status.st_size > MANIFEST_LIMIT_BYTES:
            raise InputError(f"{path} is not a plain file, or too large for a manifest.")
        raw = json.loads(path.read_bytes())
    except FileNotFoundError:
        if not folder.exists():
            raise InputError(f"{folder} does not exist.", "Run the stage that makes it first.") from None
        raise InputError(
            f"{folder} is not an artefact: it has no {MANIFEST_NAME}.", "Give the folder that a pumps stage wrote."
        ) from None
    except NotADirectoryError:
        raise InputError(
            f"{folder} is a file, not an artefact.", "Give the folder that a pumps stage wrote."
        ) from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.") from None
    except (ValueError, RecursionError):
        raise InputError(f"{path} is damaged: it is not JSON.", "Run the stage that made it again.") from None
    if not isinstance(raw, dict):
        raise InputError(
            f"{path} is not a manifest of a pumps artefact.", "Give the folder that a pumps stage wrote."
        )
    return raw


def _is_whole(value: object) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool)


def _first_missing(folder: Path, manifest: Manifest) -> str | None:
    data = folder / manifest.data
    if data.is_symlink() or not data.is_dir():
        return f"its data folder {manifest.data} is missing."
    for name in manifest.files:
        file = data / name
        if not file.is_file():
            return f"its file {manifest.data}/{name} is missing."
        # A link could lead out of the artefact: only files inside it are read.
        if not file.resolve().is_relative_to(data.resolve()):
            return f"its file {manifest.data}/{name} is a link that leads out of the artefact."
    return None


def _kind_hint(kind: str) -> str | None:
    return f"A {kind!r} artefact holds {KINDS[kind].what}." if kind in KINDS else None


def _text(value: object) -> str:
    """A short printable form of a value from a file."""
    text = "".join(c if c.isprintable() else "?" for c in str(value))
    return text if len(text) <= 200 else text[:200] + "..."
