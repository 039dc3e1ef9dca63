"""`pumps export-mesh`: a mesh sequence as a GLB with skin, as a page that plays bodies, or as a film strip."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np

from data_schemas.errors import InputError, UsageError
from data_schemas.mesh import MeshReader
from stages.export_mesh.config import Config
from stages.export_mesh.page import Played, page_of
from stages.export_mesh.strip import strip_of
from stages.shared.contract import StageReport
from stages.shared.meshes.skinned_glb import glb_of_body
from stages.shared.outputs import check_file, write_output
from stages.shared.progress import SILENT, Progress
from stages.shared.statistics.categories import named

_CLIPS = {".glb": 1, ".html": 4, ".svg": 1}  # how many are written by default


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Write the file.

    Raises: UsageError for another suffix, or several clips for a GLB; InputError for a clip that is not there, or one
        without bones for a GLB.
    """
    check_file(config, (".glb", ".html", ".svg"))
    progress.start("Writing meshes")
    kind = config.output.suffix.lower()
    with ExitStack() as opened:
        readers = {config.name: opened.enter_context(MeshReader(config.input))}
        for name, path in named("beside", config.beside, (config.name,)).items():
            readers[name] = opened.enter_context(MeshReader(path))
        names = config.clip or _first_clips(config, list(readers.values()), _CLIPS[kind])
        if kind == ".glb":
            data = _glb(config, readers[config.name], names)
        else:
            faces = {name: each.topology.faces for name, each in readers.items()}
            played = list(_played(config, readers, names))
            if kind == ".html":
                data = page_of(played, faces, f"Meshes of {config.input.name}")
            else:
                last = max(len(each.vertices) for each in played) - 1
                frames = np.unique(np.linspace(0, last, config.poses).round().astype(int))
                data = strip_of(played, faces, frames, config.start).encode("utf-8")
    write_output(config.output, data)
    size = len(data) / 1e6
    return StageReport(
        output=config.output,
        lines=[f"{config.output}: {', '.join(names)}, {size:.1f} MB."],
        figures={"clips": list(names), "bytes": len(data)},
    )


def _first_clips(config: Config, readers: list[MeshReader], most: int) -> tuple[str, ...]:
    """The first clips that all artefacts hold. Raises InputError if there is none."""
    held = [{row.clip for row in reader.clips} for reader in readers]
    names = [row.clip for row in readers[0].clips if all(row.clip in each for each in held)]
    if not names:
        raise InputError(f"No clip of {config.input} is also in all artefacts of --beside.", "Give others.")
    return tuple(names[:most])


def _played(config: Config, readers: dict[str, MeshReader], names: tuple[str, ...]) -> Iterator[Played]:
    for clip in names:
        for name, reader in readers.items():
            row = reader.row(clip)
            stop = min(row.frames, config.start + config.frames)
            if config.start >= stop:
                raise InputError(f"The clip {clip!r} has {row.frames} frames, and --start is {config.start}.")
            yield Played(clip, name, reader.vertices(clip, config.start, stop), row.fps)


def _glb(config: Config, reader: MeshReader, names: tuple[str, ...]) -> bytes:
    if len(names) != 1:
        raise UsageError("A GLB holds one clip.", "Give one --clip.")
    if config.beside:
        raise UsageError("--beside is for pages and film strips.", "Leave it out, or write a page: -o meshes.html.")
    row = reader.row(names[0])
    if not reader.is_skinned(row.clip):
        raise InputError(
            f"The clip {row.clip!r} is stored as vertices, and a GLB with skin needs bones.",
            "Write a page: -o meshes.html.",
        )
    rotations, heads = reader.bones(row.clip, config.start)
    body = reader.body(row.skeleton)
    return glb_of_body(reader.topology, body, rotations, heads, row.fps, row.clip, row.licence)
