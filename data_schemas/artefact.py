"""Writing artefacts. This is the module to import for all work with artefacts.

Order of a write: a draft folder inside the artefact is filled, hashed, flushed to the disk and renamed by its
content; then the new manifest replaces the old one in one step; only then the old data are removed. An exception or a
kill at any instant leaves the old artefact whole. The next write removes what a killed write left behind.
"""

from __future__ import annotations

import json
import math
import os
import re
import secrets
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from data_schemas.errors import InputError, PumpsError, UsageError
from data_schemas.kinds import KINDS
from data_schemas.lineage import LineageNode, lineage, verify
from data_schemas.manifest import (
    DATA_PREFIX,
    MANIFEST_NAME,
    Artefact,
    InputRef,
    Manifest,
    digest_of,
    is_inner_name,
    open_artefact,
    read_manifest,
    sha256_of_file,
)
from data_schemas.sources import digest_of_source
from data_schemas.version import PUMPS_VERSION
from data_schemas.write_lock import write_lock

__all__ = [
    "Artefact",
    "Draft",
    "InputRef",
    "LineageNode",
    "Manifest",
    "lineage",
    "open_artefact",
    "partial_folder",
    "verify",
    "write_artefact",
]

_DRAFT_PREFIX = ".draft-"
_OURS = re.compile(r"\.draft-[0-9a-f]+|\.manifest-[0-9a-f]+|data-[0-9a-f]{16}(-[0-9]+)?")


@dataclass
class Draft:
    """An artefact being written: put files into `folder`, facts into `summary`, sources' licences into `licences`."""

    folder: Path
    summary: dict[str, Any] = field(default_factory=dict)
    licences: set[str] = field(default_factory=set)


def partial_folder(path: str | os.PathLike[str]) -> Path:
    """The folder for unfinished, resumable work on the artefact `path`: NAME.partial beside it. It is not created."""
    path = Path(path)
    return path.with_name(path.name + ".partial")


@contextmanager
def write_artefact(
    path: str | os.PathLike[str],
    kind: str,
    *,
    stage: str,
    config: Mapping[str, Any] | BaseModel,
    inputs: Sequence[str | os.PathLike[str] | Artefact] = (),
    licences: Iterable[str] = (),
) -> Iterator[Draft]:
    """Write the artefact `path`. It appears when the block ends, complete or not at all.

    Args:
        path: the folder to write, created with its parents; an artefact of the same kind in it is replaced.
        kind: one of KINDS.
        stage: the stage's name, for provenance.
        config: the stage's whole config; converted to plain data.
        inputs: artefacts, or source files and folders; their digests are computed when the block begins.
        licences: of new sources; the inputs' licences are added.

    Yields:
        Draft, whose folder's files become the artefact.

    Raises:
        UsageError: `path` holds something else, which is left unchanged.
        InputError: an input is missing or damaged.
        PumpsError: another process is writing `path`, or it cannot be written.
    """
    path = Path(path)
    schema_version, plain_config = KINDS[kind].schema_version, plain_data(config)
    references, inherited = _describe_inputs(path, inputs)
    _make_folder(path)
    with write_lock(path):
        refuse_foreign(path, kind)
        _remove_leftovers(path)
        draft = Draft(path / f"{_DRAFT_PREFIX}{secrets.token_hex(8)}", licences=set(licences) | inherited)
        draft.folder.mkdir()
        try:
            yield draft
            files = _hash_and_flush(draft.folder)
            digest = digest_of(kind, schema_version, files)
            manifest = Manifest(
                kind=kind,
                schema_version=schema_version,
                created_by=f"pumps {PUMPS_VERSION}",
                stage=stage,
                config=plain_config,
                inputs=references,
                data=_settle(draft.folder, digest, files),
                files=files,
                digest=digest,
                licences=sorted(draft.licences),
                summary=plain_data(draft.summary),
            )
            _swap_manifest(path, manifest)
            _remove_leftovers(path)
        except BaseException:
            shutil.rmtree(draft.folder, ignore_errors=True)
            raise
        finally:
            _remove_if_empty(path)


def plain_data(value: Any) -> Any:
    """`value` converted to mappings, lists, text and finite numbers for JSON; paths become text, NaN becomes None."""
    if isinstance(value, Mapping):
        return {str(key): plain_data(inner) for key, inner in value.items()}
    if isinstance(value, (set, frozenset)):
        return sorted((plain_data(inner) for inner in value), key=str)
    if isinstance(value, (list, tuple)):
        return [plain_data(inner) for inner in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain_data(value.tolist())
    if isinstance(value, BaseModel):
        return plain_data(value.model_dump())
    if isinstance(value, os.PathLike):
        return Path(value).as_posix()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise TypeError(f"a manifest cannot hold a {type(value).__name__}")


def _describe_inputs(
    path: Path, inputs: Sequence[str | os.PathLike[str] | Artefact]
) -> tuple[list[InputRef], set[str]]:
    references: list[InputRef] = []
    licences: set[str] = set()
    for item in inputs:
        artefact = item if isinstance(item, Artefact) else None
        where = item.path if isinstance(item, Artefact) else Path(item)
        if artefact is None and (where / MANIFEST_NAME).is_file():
            artefact = open_artefact(where)
        if artefact is not None:
            licences |= set(artefact.manifest.licences)
            kind, digest = artefact.manifest.kind, artefact.manifest.digest
        else:
            kind, digest = digest_of_source(where)
        references.append(InputRef(path=_relative(where, path), kind=kind, digest=digest))
    return references, licences


def _relative(where: Path, to: Path) -> str:
    try:
        return Path(os.path.relpath(where.resolve(), to.resolve())).as_posix()
    except ValueError:  # another drive
        return where.resolve().as_posix()


def _make_folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise UsageError(f"{path} is a file; an artefact is a folder.", "Give another name for the output.") from None
    except OSError as error:
        raise PumpsError(f"{path} cannot be made: {error.strerror}.") from None


def refuse_foreign(path: Path, kind: str) -> None:
    """Raise UsageError if `path` holds anything but an artefact of this kind: it must not be replaced by mistake."""
    if not os.path.lexists(path / MANIFEST_NAME):
        return
    try:
        raw = json.loads((path / MANIFEST_NAME).read_bytes())
        found = raw["kind"] if isinstance(raw["schema_version"], int) else None
    except (OSError, ValueError, RecursionError, KeyError, TypeError):
        found = None
    if found is None:
        raise UsageError(
            f"{path} holds a {MANIFEST_NAME} that pumps did not write, or that is damaged.",
            "Delete it or give another output.",
        )
    if found != kind:
        raise UsageError(
            f"{path} holds a {found!r} artefact; a {kind!r} artefact must not replace it.",
            "Delete it or give another output.",
        )


def _remove_leftovers(path: Path) -> None:
    """Remove leftovers of earlier writes: drafts, and data folders that the manifest does not name."""
    current = None
    if os.path.lexists(path / MANIFEST_NAME):
        try:
            current = read_manifest(path).data
        except InputError:  # damaged or newer: its data folder is unknown, so no data folder is removed
            return
    for entry in path.iterdir():
        if _OURS.fullmatch(entry.name) and entry.name != current:
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry, ignore_errors=True)
            else:
                with suppress(OSError):
                    entry.unlink()


def _hash_and_flush(folder: Path) -> dict[str, str]:
    """Flush every file in `folder` to the disk and return its sha256. Raises PumpsError for all but plain files."""
    files: dict[str, str] = {}
    for found in sorted(folder.rglob("*")):
        name = found.relative_to(folder).as_posix()
        if found.is_symlink() or not (found.is_file() or found.is_dir()) or not is_inner_name(name):
            raise PumpsError(
                f"{name!r} cannot be part of an artefact: only plain files with plain names are allowed."
            )
        if found.is_file():
            files[name] = sha256_of_file(found)
        _flush(found)
    if not files:
        raise PumpsError(f"The stage wrote no file for {folder.parent}.")
    _flush(folder)
    return files


def _settle(draft: Path, digest: str, files: Mapping[str, str]) -> str:
    """Rename the draft by its content and return the name; an equal folder that exists already is used instead."""
    name = first = f"{DATA_PREFIX}{digest[:16]}"
    attempt = 1
    while (draft.parent / name).exists():
        if _holds(draft.parent / name, files):
            shutil.rmtree(draft)
            return name
        # A damaged copy of the same content has this name; it is removed after the manifest is replaced.
        attempt += 1
        name = f"{first}-{attempt}"
    os.rename(draft, draft.parent / name)
    _flush(draft.parent)
    return name


def _holds(folder: Path, files: Mapping[str, str]) -> bool:
    try:
        found = {f.relative_to(folder).as_posix() for f in folder.rglob("*") if not f.is_dir() or f.is_symlink()}
        return found == set(files) and all(sha256_of_file(folder / name) == sha for name, sha in files.items())
    except OSError:
        return False


def _swap_manifest(path: Path, manifest: Manifest) -> None:
    text = json.dumps(manifest.model_dump(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    temporary = path / f".manifest-{secrets.token_hex(8)}"
    with open(temporary, "wb") as file:
        file.write(text.encode("utf-8", errors="backslashreplace"))
        file.flush()
        os.fsync(file.fileno())
    os.replace(temporary, path / MANIFEST_NAME)
    _flush(path)


def _flush(path: Path) -> None:
    """Flush a file or folder to the disk, so that after a power cut no manifest names files that were lost."""
    with suppress(PermissionError):  # folders cannot be opened on every system
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _remove_if_empty(path: Path) -> None:
    """Remove the folder if a failed first write left it empty."""
    with suppress(OSError):
        if not any(entry.name != ".lock" for entry in path.iterdir()):
            (path / ".lock").unlink(missing_ok=True)
            path.rmdir()
