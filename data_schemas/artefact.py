"""Writing artefacts. This is the module to import for all work with artefacts.

Order of a write: a draft folder inside the artefact is filled, hashed, flushed to the disk and renamed by its
content; then the new manifest, also flushed, replaces the old one in one step; only then the old data are removed. An
exception, a full disk or a kill at any instant leaves the old artefact whole. The next write removes what a killed
write left behind: folders that hold pumps' marker (`data_schemas.own_folders`), and no others.
"""

from __future__ import annotations

import json
import math
import os
import re
import secrets
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ValidationError

from data_schemas.content_digest import content_digest
from data_schemas.disk import (
    cannot_be_written,
    check_room,
    disk_faults_reported,
    flush_to_disk,
    missing_above,
    remove_empty,
    write_flushed,
)
from data_schemas.errors import InputError, PumpsError, UsageError
from data_schemas.kinds import KINDS
from data_schemas.lineage import LineageNode, covers_manifest, lineage, verify
from data_schemas.manifest import (
    DATA_PREFIX,
    MANIFEST_NAME,
    MANIFEST_VERSION,
    Artefact,
    InputRef,
    Manifest,
    digest_of,
    digest_of_manifest,
    is_inner_name,
    open_artefact,
    read_manifest,
    sha256_of_file,
)
from data_schemas.own_folders import (
    MARKER_NAME,
    is_own_folder,
    make_own_folder,
    refuse_unmarked,
    remove_folder,
    remove_own_folder,
)
from data_schemas.sources import digest_of_source
from data_schemas.version import PUMPS_VERSION
from data_schemas.write_lock import LOCK_NAME, write_lock

__all__ = [
    "Artefact",
    "Draft",
    "InputRef",
    "LineageNode",
    "Manifest",
    "covers_manifest",
    "lineage",
    "open_artefact",
    "partial_folder",
    "verify",
    "write_artefact",
]

_DRAFT_PREFIX = ".draft-"
_NAMES_OF_OURS = re.compile(r"\.draft-[0-9a-f]{16}|data-[0-9a-f]{16}(-[0-9]+)?")


@dataclass
class Draft:
    """An artefact being written: put files into `folder`, facts into `summary`, sources' licences into `licences`.

    sources: (path, kind, digest) of files ("file") and folders ("folder") that the stage read and digested itself;
             they become inputs, after those given to `write_artefact`.
    """

    folder: Path
    summary: dict[str, Any] = field(default_factory=dict)
    licences: set[str] = field(default_factory=set)
    sources: list[tuple[Path, str, str]] = field(default_factory=list)


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
    least_bytes: int = 0,
) -> Iterator[Draft]:
    """Write the artefact `path`. It appears when the block ends, complete or not at all.

    Args:
        path: the folder to write, created with its parents; an artefact of the same kind in it is replaced.
        kind: one of KINDS.
        stage: the stage's name, for provenance.
        config: the stage's whole config; converted to plain data.
        inputs: artefacts, or source files and folders; their digests are computed when the block begins.
        licences: of new sources; the inputs' licences are added.
        least_bytes: what will be written at least; refused at once if the disk has less.

    Yields:
        Draft, whose folder's files become the artefact.

    Raises:
        UsageError: `path` holds something else, which is left unchanged.
        InputError: an input is missing or damaged.
        PumpsError: another process is writing `path`, or it cannot be written: the disk is full, for instance. The
            old artefact is whole, and nothing of the new one is left.
    """
    path = Path(path)
    schema_version, plain_config = KINDS[kind].schema_version, plain_data(config)
    references, inherited = _describe_inputs(path, inputs)
    made = _make_folder(path)
    with disk_faults_reported(path), write_lock(path):
        try:
            refuse_foreign(path, kind)
            check_room(path, least_bytes)
            before = _data_folder_of(path)
            _refuse_unmarked(path, before)
            _remove_leftovers(path, before)
            work = path / f"{_DRAFT_PREFIX}{secrets.token_hex(8)}"
            try:
                make_own_folder(work)
                draft = Draft(work / "data", licences=set(licences) | inherited)
                make_own_folder(draft.folder)
                yield draft
                files, content = _hash_and_flush(draft.folder, kind)
                digest = digest_of(kind, schema_version, content)
                fields = {
                    "kind": kind,
                    "schema_version": schema_version,
                    "manifest_version": MANIFEST_VERSION,
                    "created_by": f"pumps {PUMPS_VERSION}",
                    "stage": stage,
                    "config": plain_config,
                    "inputs": [*references, *(_reference(path, *source) for source in draft.sources)],
                    "files": files,
                    "content": content,
                    "digest": digest,
                    "licences": sorted(draft.licences),
                    "summary": plain_data(draft.summary),
                }
                _swap_manifest(path, work, fields | {"data": _settle(draft.folder, path, digest, files)})
            finally:
                remove_own_folder(work)
                # After the swap the old data, before it the data that no manifest came to name.
                _remove_leftovers(path, before)
        finally:
            _remove_if_empty(path, made)


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
        references.append(_reference(path, where, kind, digest))
    return references, licences


def _reference(path: Path, where: Path, kind: str, digest: str) -> InputRef:
    try:
        return InputRef(path=_relative(where, path), kind=kind, digest=digest)
    except ValidationError:
        raise PumpsError(
            f"The input {where} has a path that a manifest cannot hold.", "Give a shorter path."
        ) from None


def _relative(where: Path, to: Path) -> str:
    try:
        return Path(os.path.relpath(where.resolve(), to.resolve())).as_posix()
    except ValueError:  # another drive
        return where.resolve().as_posix()


def _make_folder(path: Path) -> list[Path]:
    """Make the folder and those above it. Returns those above it that were not there, the lowest first."""
    missing = missing_above(path)
    try:
        if not path.is_dir():
            path.mkdir(parents=True, exist_ok=True)
            flush_to_disk(path.parent)
        return missing
    except FileExistsError:
        raise UsageError(f"{path} is a file; an artefact is a folder.", "Give another name for the output.") from None
    except OSError as error:
        _remove_if_empty(path, missing)
        raise cannot_be_written(path, error) from None


def refuse_foreign(path: Path, kind: str) -> None:
    """Raise UsageError if `path` holds anything but an artefact of this kind: it must not be replaced by mistake."""
    if not os.path.lexists(path / MANIFEST_NAME):
        return
    try:
        if not stat.S_ISREG(os.lstat(path / MANIFEST_NAME).st_mode):  # a link or a pipe, say
            raise ValueError
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


def _data_folder_of(path: Path) -> str | None:
    """Name of the data folder that the manifest names; None if there is no manifest, or it is damaged or newer."""
    try:
        return read_manifest(path).data
    except InputError:
        return None


def _unnamed(path: Path, current: str | None) -> list[Path]:
    """Entries with names of pumps' own folders, except the manifest's data folder; none if that is unknown."""
    if current is None and os.path.lexists(path / MANIFEST_NAME):
        return []
    return [entry for entry in path.iterdir() if _NAMES_OF_OURS.fullmatch(entry.name) and entry.name != current]


def _refuse_unmarked(path: Path, current: str | None) -> None:
    """Raise UsageError for a folder that has a name of pumps' own folders and that pumps did not make."""
    for entry in _unnamed(path, current):
        refuse_unmarked(entry)


def _remove_leftovers(path: Path, before: str | None) -> None:
    """Remove drafts, and data folders that the manifest does not name: marked ones, and the one it named before."""
    for entry in _unnamed(path, _data_folder_of(path)):
        if entry.name == before and entry.is_dir() and not entry.is_symlink():
            remove_folder(entry)  # artefacts of older versions have no marker
        else:
            remove_own_folder(entry)


def _hash_and_flush(folder: Path, kind: str) -> tuple[dict[str, str], dict[str, str]]:
    """Flush every file in `folder` to the disk and return the sha256 of its bytes and the digest of its content.

    Raises: PumpsError for all but plain files.
    """
    files: dict[str, str] = {}
    content: dict[str, str] = {}
    for found in sorted(folder.rglob("*")):
        name = found.relative_to(folder).as_posix()
        if name != MARKER_NAME and (
            found.is_symlink() or not (found.is_file() or found.is_dir()) or not is_inner_name(name)
        ):
            raise PumpsError(
                f"{name!r} cannot be part of an artefact: only plain files with plain names are allowed."
            )
        if found.is_file() and name != MARKER_NAME:
            files[name] = sha256_of_file(found)
            says = content_digest(found, kind, files[name])
            if says is not None:
                content[name] = says
        flush_to_disk(found)
    if not files:
        raise PumpsError(f"The stage wrote no file for {folder.parent.parent}.")
    flush_to_disk(folder)
    return files, content


def _settle(draft: Path, path: Path, digest: str, files: Mapping[str, str]) -> str:
    """Rename the draft by its content and return the name; an equal folder that exists already is used instead."""
    name = first = f"{DATA_PREFIX}{digest[:16]}"
    attempt = 1
    while os.path.lexists(path / name):
        if _holds(path / name, files):
            return name
        # Other bytes of the same content have this name; they are removed after the manifest is replaced.
        attempt += 1
        name = f"{first}-{attempt}"
    os.rename(draft, path / name)
    flush_to_disk(path)
    return name


def _holds(folder: Path, files: Mapping[str, str]) -> bool:
    if not is_own_folder(folder):
        return False
    try:
        found = {f.relative_to(folder).as_posix() for f in folder.rglob("*") if not f.is_dir() or f.is_symlink()}
        return found - {MARKER_NAME} == set(files) and all(
            sha256_of_file(folder / name) == sha for name, sha in files.items()
        )
    except OSError:
        return False


def _swap_manifest(path: Path, work: Path, fields: dict[str, Any]) -> None:
    """Check the new manifest, write it to the disk and put it in the place of the old one in one step."""
    try:
        manifest = Manifest.model_validate(fields)
    except ValidationError as error:
        fault = error.errors()[0]
        raise PumpsError(
            f"The manifest of {path} cannot hold this: {'.'.join(map(str, fault['loc']))}: {fault['msg']}.",
            "Shorten that setting.",
        ) from None
    plain = manifest.model_dump(exclude={"manifest_digest"})
    plain["manifest_digest"] = digest_of_manifest(plain)
    text = json.dumps(plain, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    write_flushed(work / MANIFEST_NAME, text.encode("utf-8", errors="backslashreplace"))
    os.replace(work / MANIFEST_NAME, path / MANIFEST_NAME)
    flush_to_disk(path)


def _remove_if_empty(path: Path, made: Sequence[Path]) -> None:
    """Remove the folder, and those above it that were made for it, if a failed first write left them empty."""
    with suppress(OSError):
        if path.is_dir():
            if any(entry.name != LOCK_NAME for entry in path.iterdir()):
                return
            (path / LOCK_NAME).unlink(missing_ok=True)
            path.rmdir()
    remove_empty(made)
