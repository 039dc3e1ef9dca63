"""Reading one recording after another into skeletons and motions, in worker processes where there is much to read."""

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
from data_schemas.skeleton import Motion, Skeleton
from stages.formats.bvh import read_bvh
from stages.formats.bvh_motion import motion_of
from stages.formats.sources import Source

LEAST_FRAMES = 2
_BATCH_BYTES = 2 << 20
_POOL_FROM_BYTES = 24 << 20  # below this, starting processes costs more than it saves


@dataclass(frozen=True)
class Job:
    """One recording to read, with what the user said of it."""

    source: Source
    fps_override: float | None
    trim_first: str
    rest_frame: int | None


@dataclass(frozen=True)
class Outcome:
    """What became of a recording: `status` is "kept", "repaired" or "skipped"; `notes` say why, a sentence each."""

    source: Source
    status: str
    notes: list[str] = field(default_factory=list)
    sha256: str = ""
    skeleton: Skeleton | None = None
    motion: Motion | None = None
    hint: str | None = None


def read_one(job: Job) -> Outcome:
    """Read a recording; a bad one is an outcome and not an error."""
    try:
        data = job.source.read()
        bvh = read_bvh(data, job.source.name)
        if bvh.frames < LEAST_FRAMES:
            raise InputError(f"{job.source.name} has {bvh.frames} frame, and a motion needs at least {LEAST_FRAMES}.")
        skeleton, motion, notes = motion_of(
            bvh, fps_override=job.fps_override, rest_frame=job.rest_frame, trim_first=job.trim_first
        )
    except InputError as error:
        return Outcome(job.source, "skipped", [error.message], hint=error.hint)
    status = "repaired" if notes else "kept"
    return Outcome(job.source, status, notes, hashlib.sha256(data).hexdigest(), skeleton, motion)


def read_all(jobs: Sequence[Job], workers: int) -> Iterator[Outcome]:
    """Outcomes of all jobs, in order. `workers` processes, 0 for one per core."""
    count = workers or (len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)
    if count <= 1 or sum(job.source.size for job in jobs) < _POOL_FROM_BYTES:
        yield from map(read_one, jobs)
        return
    with ProcessPoolExecutor(count, mp_context=_context()) as pool:
        # A short queue ahead of the reader of outcomes: enough to keep the processes busy, little memory.
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
    """Processes that start clean: a fork would copy the threads' locks of whatever library the caller has loaded."""
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
    """Jobs in runs of a few megabytes, so that small files do not cost a message each."""
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
