"""Verifying that an artefact is unchanged, and listing what it was made from."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pyarrow as pa

from data_schemas.content_digest import content_digest
from data_schemas.errors import InputError
from data_schemas.manifest import (
    MANIFEST_VERSION,
    Artefact,
    InputRef,
    Manifest,
    manifest_has_changed,
    open_artefact,
    sha256_of_file,
)
from data_schemas.own_folders import MARKER_NAME

State = Literal["same", "changed", "missing", "damaged", "cyclic", "unchecked"]

_DEPTH_LIMIT = 32  # far beyond any real pipeline; a hostile manifest could be deeper or wider
_NODE_LIMIT = 2000


@dataclass(frozen=True)
class LineageNode:
    """One artefact or source file in the tree of what an artefact was made from.

    path:   where it was expected.
    kind:   kind of artefact, "file" or "folder".
    stage:  the stage that wrote it; "" for sources and for what could not be read.
    digest: its digest as recorded by the artefact that was made from it; for the tree's root, its own.
    state:  "same" as when it was read, "changed" since then, "missing", "damaged", "cyclic" (a faulty manifest),
            or "unchecked" (a folder of sources, which is not read again; or a tree too large to follow).
    created_by, licences: those of its manifest.
    inputs: the artefacts and files it was made from.
    """

    path: Path
    kind: str
    stage: str
    digest: str
    state: State
    created_by: str = ""
    licences: tuple[str, ...] = ()
    inputs: tuple[LineageNode, ...] = ()


def verify(path: str | os.PathLike[str]) -> list[str]:
    """Compare an artefact with what was written: its files byte for byte, and every field of its manifest.

    An older artefact's manifest holds no digest of its own fields: of those, only the files are compared
    (`covers_manifest`).

    Returns:
        One sentence for each problem; empty if nothing has changed.

    Raises:
        InputError: `path` is not an artefact (it is missing, or its manifest cannot be read).
    """
    artefact = open_artefact(path)
    manifest = artefact.manifest
    problems: list[str] = []
    for name, expected in manifest.files.items():
        try:
            found = sha256_of_file(artefact.folder / name)
        except OSError as error:
            problems.append(f"{name} cannot be read: {error.strerror}.")
            continue
        if found != expected:
            problems.append(f"{name} has changed: its sha256 is {found}, the manifest says {expected}.")
        elif covers_manifest(manifest) and not _says(artefact.folder / name, manifest, name, found):
            problems.append(f"{name} does not hold what the manifest's digest was made of.")
    for extra in sorted(artefact.folder.rglob("*")):
        name = extra.relative_to(artefact.folder).as_posix()
        if not extra.is_dir() and name not in manifest.files and name != MARKER_NAME:
            problems.append(f"{name} is not listed in the manifest.")
    if manifest.digest != manifest.expected_digest:
        problems.append("The manifest's digest does not match the files it lists.")
    if covers_manifest(manifest) and manifest_has_changed(artefact.path):
        problems.append(
            "The manifest has changed: its config, inputs, licences, summary or another field is not as written."
        )
    return problems


def covers_manifest(manifest: Manifest) -> bool:
    """Whether `verify` can find changes of the manifest's own fields; artefacts of older versions do not allow it."""
    return manifest.manifest_version >= MANIFEST_VERSION


def _says(path: Path, manifest: Manifest, name: str, sha256: str) -> bool:
    try:
        return content_digest(path, manifest.kind, sha256) == manifest.content.get(name)
    except (OSError, ValueError, KeyError, TypeError, RuntimeError, MemoryError, pa.ArrowException):
        return False


def lineage(path: str | os.PathLike[str]) -> LineageNode:
    """The tree of the inputs from which `path` was made, each input looked up at its recorded path.

    The digest of an artefact is taken from its manifest, that of a source file is computed from its bytes.

    Raises:
        InputError: `path` itself cannot be opened.
    """
    artefact = open_artefact(path)
    return _Walk().node(artefact, artefact.manifest.digest, ())


class _Walk:
    """One walk over the inputs. It is bounded, since manifests may be hostile; each source file is read once."""

    def __init__(self) -> None:
        self._source_digests: dict[Path, str] = {}
        self._nodes = 0

    def node(self, artefact: Artefact, recorded: str, above: tuple[Path, ...]) -> LineageNode:
        manifest = artefact.manifest
        here = artefact.path.resolve()
        return LineageNode(
            path=artefact.path,
            kind=manifest.kind,
            stage=manifest.stage,
            digest=recorded,
            state="same" if manifest.digest == recorded else "changed",
            created_by=manifest.created_by,
            licences=tuple(manifest.licences),
            inputs=tuple(self._input(here, reference, (*above, here)) for reference in manifest.inputs),
        )

    def _input(self, base: Path, reference: InputRef, above: tuple[Path, ...]) -> LineageNode:
        path = Path(os.path.normpath(base / reference.path))
        self._nodes += 1
        try:
            if self._nodes > _NODE_LIMIT or len(above) >= _DEPTH_LIMIT:
                state: State = "unchecked"
            elif path.resolve() in above:
                state = "cyclic"
            elif reference.kind == "file":
                state = self._state_of_file(path, reference.digest)
            elif reference.kind == "folder":
                state = "unchecked" if path.is_dir() else "missing"
            elif not path.exists():
                state = "missing"
            else:
                return self.node(open_artefact(path), reference.digest, above)
        except InputError:
            state = "damaged"
        except (OSError, ValueError):  # not a valid path on this system
            state = "missing"
        return LineageNode(path, reference.kind, "", reference.digest, state)

    def _state_of_file(self, path: Path, recorded: str) -> State:
        if not path.is_file():
            return "missing"
        if path not in self._source_digests:
            self._source_digests[path] = sha256_of_file(path)
        return "same" if self._source_digests[path] == recorded else "changed"
