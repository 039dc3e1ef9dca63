"""Reading recordings into skeletons and motions, in worker processes if there is much to read."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing.context import BaseContext

from data_schemas.errors import InputError, PumpsError
from data_schemas.notes import Flag, Note, note
from data_schemas.quality import MotionQuality
from stages.shared.formats.readers import AUTO, format_named, read_recordings, recognise
from stages.shared.formats.recording import Asked, Recording
from stages.shared.formats.sources import Source
from stages.shared.humanoid.motion_quality import measure_quality
from stages.shared.kinematics.forward_numpy import positions_of

LEAST_FRAMES = 2
_BATCH_BYTES = 2 << 20
_POOL_FROM_BYTES = 24 << 20  # for less, starting processes takes longer than it saves


@dataclass(frozen=True)
class Job:
    """One source to read, with the user's settings. `format` is a format's name, or "auto"."""

    source: Source
    format: str
    asked: Asked


@dataclass(frozen=True)
class Outcome:
    """The outcome of reading a source: `status` is one of `data_schemas.source_table.OUTCOMES`.

    format: its format, "" if it was not recognised. reason: why it was not used, else "". hint: how to correct it.
    notes: faults that were corrected. remarks: assumptions about facts that no file states.
    qualities: one for each recording.
    """

    source: Source
    status: str
    format: str = ""
    notes: list[Note] = field(default_factory=list)
    remarks: list[Note] = field(default_factory=list)
    sha256: str = ""
    recordings: list[Recording] = field(default_factory=list)
    qualities: list[MotionQuality] = field(default_factory=list)
    reason: str = ""
    hint: str | None = None


def read_one(job: Job) -> Outcome:
    """Read a source; a fault of the source is returned as an outcome, not raised."""
    source = job.source
    chosen = None
    try:
        data = source.read()
        chosen = recognise(data, source.name) if job.format == AUTO else format_named(job.format)
        if chosen is None:
            if source.named:
                raise InputError(
                    f"{source.name} is not a recording in a format that pumps reads.",
                    "docs/formats.md lists the formats.",
                )
            return Outcome(source, "ignored", reason="It holds no motion.")
        found = read_recordings(data, source, chosen, job.asked)
        recordings = [recording for recording in found if recording.motion.frames >= LEAST_FRAMES]
        if not recordings:
            count = max((recording.motion.frames for recording in found), default=0)
            raise InputError(f"{source.name} has {count} frame, and a motion needs at least {LEAST_FRAMES}.")
    except InputError as error:
        name = chosen.name if chosen else ""
        return Outcome(source, "skipped", name, reason=error.message, hint=error.hint)
    notes = list(dict.fromkeys(each for recording in recordings for each in recording.notes))
    remarks = list(dict.fromkeys(each for recording in recordings for each in recording.remarks))
    if len(recordings) < len(found):
        notes.append(note(Flag.ONE_FRAME_CLIPS, clips=len(found) - len(recordings)))
    sha256 = hashlib.sha256(data).hexdigest()
    qualities = [quality_of(recording) for recording in recordings]
    status = "repaired" if notes else "kept"
    return Outcome(source, status, chosen.name, notes, remarks, sha256, recordings, qualities)


def quality_of(recording: Recording) -> MotionQuality:
    """Measures of the clip (`data_schemas.quality`)."""
    skeleton, motion = recording.skeleton, recording.motion
    return measure_quality(skeleton, motion, positions_of(skeleton, motion), recording.repaired_frames)


def read_all(jobs: Sequence[Job], workers: int) -> Iterator[Outcome]:
    """Outcomes of all jobs, in order. `workers` processes, 0 for one per core."""
    count = workers or (len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)
    if count <= 1 or sum(job.source.size for job in jobs) < _POOL_FROM_BYTES:
        yield from map(read_one, jobs)
        return
    with ProcessPoolExecutor(count, mp_context=_context()) as pool:
        # A short queue of outcomes keeps the processes busy and takes little memory.
        waiting: deque[Future[list[Outcome]]] = deque()
        try:
            for batch in _batches(jobs):
                waiting.append(pool.submit(_read_batch, batch))
                if len(waiting) > 3 * count:
                    yield from _result(waiting.popleft())
            while waiting:
                yield from _result(waiting.popleft())
        finally:
            for future in waiting:
                future.cancel()


def _context() -> BaseContext:
    """Processes that are spawned, since a fork would copy the locks held by threads of the caller's libraries."""
    methods = multiprocessing.get_all_start_methods()
    return multiprocessing.get_context("forkserver" if "forkserver" in methods else "spawn")


def _read_batch(jobs: Sequence[Job]) -> list[Outcome]:
    return [read_one(job) for job in jobs]


def _result(future: Future[list[Outcome]]) -> list[Outcome]:
    try:
        return future.result()
    except MemoryError:
        raise PumpsError("A reading process ran out of memory.", "Give fewer --workers.") from None


def _batches(jobs: Sequence[Job]) -> Iterator[list[Job]]:
    """Jobs in groups of a few megabytes, so that small files do not need a message each."""
    batch: list[Job] = []
    size = 0
    for job in jobs:
        batch.append(job)
        size += job.source.size
        if size >= _BATCH_BYTES:
            yield batch
            batch, size = [], 0
    if batch:
        yield batch
