"""The motions to put on bodies: those of a motion artefact, or of one recording."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import PurePosixPath

from data_schemas.artefact import open_artefact
from data_schemas.clip_filter import clips_where
from data_schemas.clips import ClipRow
from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import Artefact
from data_schemas.motion import MotionReader
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.readers import recordings_in
from stages.shared.formats.recording import Asked
from stages.shared.formats.sources import source_named
from stages.skin.config import Config


@dataclass(frozen=True)
class Motions:
    """rows: of the clips, at their own rates. each: their skeletons and motions, in the same order."""

    rows: list[ClipRow]
    each: Iterator[tuple[Skeleton, Motion]]
    artefact: Artefact | None


@contextmanager
def opened_motions(config: Config) -> Iterator[Motions]:
    """The motions of `config.input`.

    Raises: InputError where it holds none; UsageError for an expression that no clip satisfies.
    """
    if config.input.is_dir():
        artefact = open_artefact(config.input, "motion")
        with MotionReader(artefact) as reader:
            rows = list(clips_where(reader.clips, config.where))
            each = ((reader.skeleton(row.skeleton), reader.motion(row.clip)) for row in rows)
            yield Motions(rows, each, artefact)
        return
    if config.where is not None:
        raise UsageError("--where chooses clips of an artefact, and a recording is given.", "Leave it out.")
    source = source_named(str(config.input))
    found = list(recordings_in(source, Asked()))
    if not found:
        raise InputError(f"{source.name} holds no motion.")
    digest = hashlib.sha256(source.read()).hexdigest()
    stem = PurePosixPath(source.member.replace("\\", "/")).stem
    rows = []
    for recording in found:
        motion = recording.motion
        rows.append(
            ClipRow(
                clip=f"{stem}.{recording.part}" if recording.part else stem, source=source.name, sha256=digest,
                skeleton="", frames=motion.frames, fps=motion.fps, seconds=motion.frames / motion.fps,
                split="test", licence=config.licence or "unknown",
            )
        )  # fmt: skip
    yield Motions(rows, iter([(recording.skeleton, recording.motion) for recording in found]), None)
