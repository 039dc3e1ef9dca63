"""Is an artefact as it was written, and where does it come from?"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from data_schemas.errors import InputError
from data_schemas.manifest import MANIFEST_NAME, Artefact, digest_of, open_artefact, sha256_of_file
from data_schemas.sources import digest_of_source

State = Literal["same", "changed", "missing", "damaged", "cyclic"]

_DEPTH_LIMIT = 32  # no pipeline is so deep; a made-up manifest could be


@dataclass(frozen=True)
class LineageNode:
    """One artefact or source file in the tree of what an artefact was made from.

    path:   where it was looked for.
    kind:   kind of artefact, "file" or "folder".
    stage:  the stage that wrote it; "" for sources and for what could not be read.
    digest: its digest as its user recorded it; for the tree's root, its own.
    state:  "same" as its user read it, "changed" since, "missing", "damaged", or "cyclic" (a made-up manifest).
    created_by, licences: as in its manifest.
    inputs: what it was made from.
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
    """Compare an artefact's files with its manifest, byte for byte.

    Returns:
        One sentence for each problem; empty if all is as it was written.

    Raises:
        InputError: `path` is no artefact at all (missing, or its manifest cannot be read).
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
    for extra in sorted(artefact.folder.rglob("*")):
        name = extra.relative_to(artefact.folder).as_posix()
        if not extra.is_dir() and name not in manifest.files:
            problems.append(f"{name} is not listed in the manifest.")
    if manifest.digest != digest_of(manifest.kind, manifest.schema_version, manifest.files):
        problems.append("The manifest's digest does not belong to the files it lists.")
    return problems


def lineage(path: str | os.PathLike[str]) -> LineageNode:
    """The tree of what `path` was made from, each input looked for where it was recorded.

    Digests of artefacts are compared by their manifests, those of source files by their bytes.

    Raises:
        InputError: `path` itself cannot be opened.
    """
    artefact = open_artefact(path)
    return _node(artefact, artefact.manifest.digest, (), {})


def _node(
    artefact: Artefact, recorded: str, above: tuple[Path, ...], sources: dict[Path, tuple[str, str]]
) -> LineageNode:
    manifest = artefact.manifest
    here = artefact.path.resolve()
    inputs = tuple(
        _input_node(
            Path(os.path.normpath(here / reference.path)), reference.kind, reference.digest, (*above, here), sources
        )
        for reference in manifest.inputs
    )
    state: State = "same" if manifest.digest == recorded else "changed"
    return LineageNode(
        artefact.path,
        manifest.kind,
        manifest.stage,
        recorded,
        state,
        manifest.created_by,
        tuple(manifest.licences),
        inputs,
    )


def _input_node(
    path: Path, kind: str, recorded: str, above: tuple[Path, ...], sources: dict[Path, tuple[str, str]]
) -> LineageNode:
    def leaf(state: State) -> LineageNode:
        return LineageNode(path, kind, "", recorded, state)

    if path.resolve() in above or len(above) >= _DEPTH_LIMIT:
        return leaf("cyclic")
    try:
        if kind in ("file", "folder"):
            if path not in sources:
                sources[path] = digest_of_source(path)
            return leaf("same" if sources[path] == (kind, recorded) else "changed")
        if not (path / MANIFEST_NAME).exists():
            return leaf("missing")
        return _node(open_artefact(path), recorded, above, sources)
    except InputError:
        return leaf("damaged" if path.exists() else "missing")
