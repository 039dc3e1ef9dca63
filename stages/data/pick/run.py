"""`pumps data pick`: a few test clips, copied out of their sources as they came, to be filled and looked at."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from data_schemas.clips import ClipRow
from data_schemas.errors import InputError
from data_schemas.manifest import open_artefact
from data_schemas.motion import MotionReader
from data_schemas.notes import Flag
from stages.data.pick.config import Config
from stages.shared.contract import StageReport
from stages.shared.file_names import FileNames
from stages.shared.formats.bvh_of_motion import bvh_of_motion
from stages.shared.formats.readers import recognise
from stages.shared.formats.sources import source_named
from stages.shared.outputs import check_folder, check_replaceable, paths_in, write_output
from stages.shared.progress import SILENT, Progress

LIST_NAME = "clips.txt"
# What would need the options of ingest again.
_UNHANDY = {Flag.FPS_OVERRIDE, Flag.TRIMMED, Flag.FRAMES_LINE_OFF}
_SHORTEST_S = 2.0  # below it there is hardly a gap to fill


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Write OUTPUT/<clip>.bvh for each clip picked, then OUTPUT/clips.txt, which lists them.

    Clips that an earlier list names and this one does not are removed.

    Raises:
        UsageError: the folder holds files that may not be replaced, or a source that a clip is copied from.
        InputError: the artefact has no clip of these splits, or its sources are gone.
    """
    check_folder(config)
    artefact = open_artefact(config.motion, "motion")
    with MotionReader(artefact) as reader:
        picked = pick(reader.clips, config)
        if not picked:
            raise InputError(
                f"{config.motion} has no clip in the split {' or '.join(config.splits)}.",
                "Name some in the file given to `pumps ingest --splits`.",
            )
        config.output.mkdir(parents=True, exist_ok=True)
        names = FileNames()
        paths = dict.fromkeys(path for row in reader.clips for path in paths_in(row.source))
        sources = [("a source", path) for path in paths if os.path.exists(path)]
        files = [f"{names.of(row.clip)}.bvh" for row in picked]
        stale = sorted(_listed(config.output) - {*files})
        for file in (*files, *stale):
            check_replaceable(config.output / file, True, sources)
        progress.start("Copying clips", len(picked))
        for row, file in zip(picked, files, strict=True):
            write_output(config.output / file, _as_bvh(row, reader))
            progress.advance(1, row.clip)
    for file in stale:
        (config.output / file).unlink(missing_ok=True)
    write_output(config.output / LIST_NAME, "".join(f"{file}\n" for file in files).encode())
    clips = [row.clip for row in picked]
    return StageReport(output=config.output, lines=[f"picked {', '.join(clips)}"], figures={"clips": clips})


def _listed(folder: Path) -> set[str]:
    """The BVH files of `folder` that its list names."""
    try:
        lines = (folder / LIST_NAME).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return set()
    return {name for name in lines if name.endswith(".bvh") and Path(name).name == name}


def _as_bvh(row: ClipRow, reader: MotionReader) -> bytes:
    """A BVH as it came, byte for byte; a clip of another format written as one."""
    data = source_named(row.source).read()
    found = recognise(data, row.source)
    if found is not None and found.name == "bvh":
        return data
    return bvh_of_motion(reader.skeleton(row.skeleton), reader.motion(row.clip), row.clip)


def pick(rows: Sequence[ClipRow], config: Config) -> list[ClipRow]:
    """Clips in turn from each pair of archive and skeleton, the handiest first. No chance is in it.

    Handy is a clip of a fit length that ingest took as it is: one with a wrong rate or a calibration frame would
    need the same options again when it is filled.
    """

    def order(row: ClipRow) -> tuple[bool, bool, str]:
        return (
            not _UNHANDY.isdisjoint(row.flags.split()),
            not _SHORTEST_S <= row.seconds <= config.longest_s,
            row.clip,
        )

    kinds: dict[tuple[str, str], list[ClipRow]] = {}
    for row in sorted(rows, key=order):
        if row.split in config.splits:
            archive = row.source.partition("!")[0] if "!" in row.source else ""
            kinds.setdefault((archive, row.skeleton), []).append(row)
    picked: list[ClipRow] = []
    queues = [kinds[kind] for kind in sorted(kinds)]
    while len(picked) < config.count and any(queues):
        for queue in queues:
            if queue and len(picked) < config.count:
                picked.append(queue.pop(0))
    return picked
