"""Reading recordings into skeletons and motions, in worker processes if there is much to read."""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from itertools import tee

from data_schemas.errors import InputError
from data_schemas.motion import fault_of_motion, fault_of_skeleton
from data_schemas.notes import Flag, Note, note
from data_schemas.quality import MotionQuality
from stages.shared.formats.readers import AUTO, Format, format_named, read_recordings, recognise
from stages.shared.formats.recording import Asked, Recording
from stages.shared.formats.sources import Source
from stages.shared.humanoid.motion_quality import measure_quality
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.pools import TaskDied, cluster_pool, process_pool, results_in_order
from stages.shared.threads import cores

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
    sha256: of the source's bytes; "" if they could not be read. qualities: one for each recording.
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
    """Read a source; whatever fails is returned as this source's outcome, not raised."""
    source, data, chosen = job.source, None, None
    try:
        data = source.read()
        chosen = recognise(data, source.name) if job.format == AUTO else format_named(job.format)
        return _outcome_of(job, data, chosen)
    except InputError as error:
        reason, hint = error.message, error.hint
    except MemoryError:
        reason = f"{source.name} takes more memory than there is."
        hint = "Give fewer --workers, or cut the file into shorter ones."
    except Exception as error:  # a fault of one reader must not cost all other files
        cause = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        reason = f"{source.name} cannot be read: its reader failed ({cause})."
        hint = "This is a fault of pumps; please report it with the file."
    sha256 = "" if data is None else hashlib.sha256(data).hexdigest()
    return Outcome(source, "skipped", chosen.name if chosen else "", sha256=sha256, reason=reason, hint=hint)


def _outcome_of(job: Job, data: bytes, chosen: Format | None) -> Outcome:
    """The recordings of a source's bytes in a format. Raises InputError if they are not motion."""
    source = job.source
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
    for recording in recordings:
        skeleton = recording.skeleton
        fault = fault_of_skeleton(skeleton) or fault_of_motion(recording.motion, skeleton.joints)
        if fault:
            raise InputError(f"{source.name} {fault}.", "Check the file.")
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


def read_all(jobs: Sequence[Job], workers: int, cluster: str | None = None) -> Iterator[Outcome]:
    """Outcomes of all jobs, in order. `workers` processes, 0 for one per core; or the workers of a cluster."""
    if cluster is not None and jobs:
        with cluster_pool(cluster) as pool:
            yield from _read_in_cluster(jobs, pool)
        return
    count = workers or cores()
    if count <= 1 or sum(job.source.size for job in jobs) < _POOL_FROM_BYTES:
        yield from map(read_one, jobs)
        return
    yield from _read_in_processes(jobs, count)


def _read_in_processes(jobs: Sequence[Job], count: int) -> Iterator[Outcome]:
    """Outcomes of all jobs, in order. If a process dies, the file that caused it is found and skipped."""
    batches = _batches(jobs)
    # A short queue of outcomes keeps the processes busy and takes little memory.
    waiting: deque[tuple[list[Job], Future[list[Outcome]] | None]] = deque()
    pool = process_pool(count)
    try:
        while True:
            while len(waiting) <= 3 * count and (batch := next(batches, None)) is not None:
                waiting.append((batch, _submitted(pool, batch)))
            if not waiting:
                return
            batch, future = waiting.popleft()
            outcomes = _result(future)
            if outcomes is None:  # unfinished batches are lost with the dead process, and read in new ones
                pool.shutdown(cancel_futures=True)
                for lost, theirs in [(batch, None), *waiting]:
                    yield from _result(theirs) or _read_apart(lost)
                waiting.clear()
                pool = process_pool(count)
            else:
                yield from outcomes
    finally:
        pool.shutdown(cancel_futures=True)


def _read_in_cluster(jobs: Sequence[Job], pool: Executor) -> Iterator[Outcome]:
    """Outcomes of all jobs, in order. The jobs of a batch that ended several workers are read again, one by one."""
    batches, same = tee(_batches(jobs))
    for batch, outcomes in zip(same, results_in_order(pool, _read_batch, batches), strict=True):
        if not isinstance(outcomes, TaskDied):
            yield from outcomes
            continue
        for job, alone in zip(batch, results_in_order(pool, read_one, batch, ahead=1), strict=True):
            yield _died(job.source) if isinstance(alone, TaskDied) else alone


def _read_apart(jobs: Sequence[Job]) -> Iterator[Outcome]:
    """Outcomes of a batch, read in a new process; if that dies too, each job in a process of its own."""
    for part in [jobs] if len(jobs) == 1 else [jobs, *([job] for job in jobs)]:
        with process_pool(1) as pool:
            outcomes = _result(_submitted(pool, list(part)))
        if outcomes is not None:
            yield from outcomes
            if len(part) == len(jobs):
                return
        elif len(part) == 1:
            yield _died(part[0].source)


def _died(source: Source) -> Outcome:
    return Outcome(
        source,
        "skipped",
        reason=f"The process that read {source.name} was ended, perhaps for want of memory.",
        hint="Give fewer --workers, or cut the file into shorter ones.",
    )


def _read_batch(jobs: Sequence[Job]) -> list[Outcome]:
    return [read_one(job) for job in jobs]


def _submitted(pool: ProcessPoolExecutor, batch: list[Job]) -> Future[list[Outcome]] | None:
    try:
        return pool.submit(_read_batch, batch)
    except BrokenProcessPool:
        return None


def _result(future: Future[list[Outcome]] | None) -> list[Outcome] | None:
    """The outcomes of a batch; None if the process that read it died, or could not send them for want of memory."""
    try:
        return None if future is None else future.result()
    except (BrokenProcessPool, CancelledError, MemoryError):
        return None


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
