"""`pumps data pick`: a few test clips, copied out of their sources as they came, to be filled and looked at."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from data_schemas.clips import ClipRow
from data_schemas.errors import InputError
from data_schemas.manifest import open_artefact, sha256_of_file
from data_schemas.motion import MotionReader
from data_schemas.notes import Flag
from stages.data.pick.config import Config
from stages.shared.contract import StageReport
from stages.shared.file_names import FileNames, is_file_name
from stages.shared.formats.bvh_of_motion import bvh_of_motion
from stages.shared.formats.readers import recognise
from stages.shared.formats.sources import source_named
from stages.shared.outputs import check_folder, check_replaceable, paths_in, write_output
from stages.shared.progress import SILENT, Progress

LIST_NAME = "clips.txt"
DIGESTS_NAME = ".clips.sha256"  # of the files as they were written, one a line as `sha256sum` has them
# What would need the options of ingest again.
_UNHANDY = {Flag.FPS_OVERRIDE, Flag.TRIMMED, Flag.FRAMES_LINE_OFF}
_SHORTEST_S = 2.0  # below it there is hardly a gap to fill


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Write OUTPUT/<clip>.bvh for each clip picked, then OUTPUT/clips.txt, which lists them.

    Clips of an earlier pick that are not picked now are removed if they are still as they were written: their digests
    lie in OUTPUT/.clips.sha256. Other files stay, and the report names those that the earlier list has.

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
        names = FileNames()
        paths = dict.fromkeys(path for row in reader.clips for path in paths_in(row.source))
        sources = [("a source", path) for path in paths if os.path.exists(path)]
        files = [f"{names.of(row.clip)}.bvh" for row in picked]
        listed = _lines(config.output / LIST_NAME)
        written = _written(config.output)
        stale = sorted({*written} - {*files})
        for file in (*files, *stale):
            check_replaceable(config.output / file, True, sources)
        progress.start("Copying clips", len(picked))
        digests = {}
        for row, file in zip(picked, files, strict=True):
            data = _as_bvh(row, reader)
            write_output(config.output / file, data)
            digests[file] = hashlib.sha256(data).hexdigest()
            progress.advance(1, row.clip)
    removed = [file for file in stale if _is_as_written(config.output / file, written[file])]
    # The digests of these files stay until the files are removed: the next run finishes an interrupted removal.
    _write_digests(config.output, {file: written[file] for file in removed} | digests)
    for file in removed:
        (config.output / file).unlink(missing_ok=True)
    write_output(config.output / LIST_NAME, "".join(f"{file}\n" for file in files).encode())
    _write_digests(config.output, digests)
    clips = [row.clip for row in picked]
    lines = [f"picked {', '.join(clips)}"]
    if left := sorted(file for file in {*listed, *stale} - {*files, *removed} if _is_there(config.output, file)):
        lines.append(f"Files of the earlier {LIST_NAME} that are not as pumps wrote them stay: {', '.join(left)}.")
    return StageReport(output=config.output, lines=lines, figures={"clips": clips, "removed": removed})


def _written(folder: Path) -> dict[str, str]:
    """The BVH files that an earlier pick wrote into `folder`, with their digests."""
    pairs = (line.partition("  ") for line in _lines(folder / DIGESTS_NAME))
    return {name: digest for digest, _, name in pairs if name.endswith(".bvh") and is_file_name(name)}


def _write_digests(folder: Path, digests: Mapping[str, str]) -> None:
    text = "".join(f"{digest}  {name}\n" for name, digest in digests.items())
    write_output(folder / DIGESTS_NAME, text.encode())


def _is_as_written(path: Path, digest: str) -> bool:
    """Whether a plain file has this SHA-256."""
    try:
        return not path.is_symlink() and path.is_file() and sha256_of_file(path) == digest
    except OSError:
        return False


def _is_there(folder: Path, name: str) -> bool:
    return is_file_name(name) and (folder / name).exists()


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return []


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
