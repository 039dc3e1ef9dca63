"""Merging artefacts of clips into one, for collections that were read in parts, on one machine or several."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import h5py

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.clips import ClipReader, ClipRow, write_clips
from data_schemas.damaged_files import reading
from data_schemas.errors import InputError, UsageError
from data_schemas.hdf5_arrays import group_in
from data_schemas.hdf5_writing import NewHdf5
from data_schemas.latent import LatentReader
from data_schemas.manifest import Artefact
from data_schemas.motion import MotionReader
from data_schemas.source_table import SourceRow, read_sources, write_sources
from data_schemas.tpc import TpcReader

READERS: dict[str, type[ClipReader]] = {reader.KIND: reader for reader in (MotionReader, TpcReader, LatentReader)}


def merge_artefacts(paths: Sequence[str | os.PathLike[str]], output: str | os.PathLike[str]) -> tuple[ClipRow, ...]:
    """Write one artefact with the clips of all given ones, in the order of their sources; returns its index.

    Clips of the same name from different sources are renamed. Equal skeletons and sets of bones are stored once.

    Args:
        paths: two or more `motion`, `tpc` or `latent` artefacts of one kind; latents must be of one encoder.

    Raises: UsageError for kinds that differ or hold no clips; InputError for a source that is in two artefacts, for
        latents of different encoders, or for damaged data.
    """
    artefacts = [open_artefact(path) for path in paths]
    kinds = sorted({artefact.manifest.kind for artefact in artefacts})
    if len(kinds) != 1 or kinds[0] not in READERS:
        raise UsageError(
            f"Artefacts of the kinds {', '.join(kinds)} cannot be merged.", f"Give {' or '.join(READERS)} artefacts."
        )
    stages = sorted({artefact.manifest.stage for artefact in artefacts})
    with ExitStack() as opened:
        readers = [opened.enter_context(READERS[kinds[0]](artefact)) for artefact in artefacts]
        config = {"merged": [artefact.manifest.config for artefact in artefacts], "stages": stages}
        # Groups are copied as they are stored, so that the whole is as large as its parts, but for what they share.
        least = sum(reader.stored_bytes for reader in readers) // 2
        with write_artefact(
            output, kinds[0], stage="merge", config=config, inputs=artefacts, least_bytes=least
        ) as draft:
            rows = _merge_into(draft.folder, readers)
            draft.summary |= {"clips": len(rows), "frames": sum(row.frames for row in rows), "parts": len(readers)}
    return rows


def _merge_into(folder: Path, readers: Sequence[ClipReader]) -> tuple[ClipRow, ...]:
    rows: list[ClipRow] = []
    sources: list[SourceRow] = []
    seen: dict[tuple[str, str], Artefact] = {}
    names: set[str] = set()
    new = NewHdf5(folder / readers[0].FILE)
    with new as file:
        clips = file.create_group("clips")
        for reader in readers:
            sources += read_sources(reader.folder)
            with (
                reading(reader.folder / reader.FILE),
                h5py.File(reader.folder / reader.FILE, "r", locking=False) as part,
            ):
                _merge_shared(part, file, reader.artefact)
                here = {(row.source, row.sha256) for row in reader.clips}
                twice = next((key for key in here if key in seen), None)
                if twice:
                    raise InputError(f"{twice[0]} is in {seen[twice].path} and in {reader.artefact.path}.")
                seen |= dict.fromkeys(here, reader.artefact)
                for row in reader.clips:
                    name = _free_name(row.clip, names)
                    part.copy(group_in(group_in(part, "clips"), row.clip), clips, name)
                    new.check()
                    rows.append(replace(row, clip=name))
    rows.sort(key=lambda row: (row.source, row.clip))
    write_clips(folder, rows)
    if sources:
        write_sources(folder, sorted(sources, key=lambda row: row.source))
    return tuple(rows)


def _merge_shared(part: h5py.File, file: h5py.File, artefact: Artefact) -> None:
    """Copy the data that clips share (skeletons, bones) and that apply to the whole file (the encoder's digest)."""
    for name, value in part.attrs.items():
        if file.attrs.setdefault(name, value) != value:
            raise InputError(f"{artefact.path} has a different {name.replace('_', ' ')} than the others.")
    for name, group in part.items():
        if name == "clips":
            continue
        shared = file.require_group(name)
        for key in group:
            if key not in shared:
                part.copy(group[key], shared, key)
            elif shared[key].attrs.get("content") != group[key].attrs.get("content"):
                raise InputError(
                    f"{artefact.path} has different {name} of the id {key!r} than the others.",
                    "Make the parts with the same settings and seed.",
                )


def _free_name(wanted: str, taken: set[str]) -> str:
    name, copy = wanted, 1
    while name.lower() in taken:
        copy += 1
        name = f"{wanted[:190]}-{copy}"
    taken.add(name.lower())
    return name
