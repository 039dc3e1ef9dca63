"""Fills and verbs, which take longer than a request. They run one by one, show progress, and can be cancelled."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from queue import Queue
from typing import Any, Literal

from data_schemas.errors import PumpsError, UsageError
from stages.studio.worker import CancelledError, Told, Worker

MOST_WAITING = 32
_MOST_KEPT = 200


@dataclass
class Job:
    """One job and how far it is.

    work: called with a function that tells progress; it returns what the page shall show, such as the new motion.
    done, total: steps; total 0 where it is not known. error: the sentence, where it failed.
    """

    session: str
    work: Callable[[Told], dict[str, Any]]
    id: str = field(default_factory=lambda: secrets.token_hex(8))
    state: Literal["waiting", "running", "done", "failed", "cancelled"] = "waiting"
    label: str = "waiting"
    done: float = 0.0
    total: float = 0.0
    error: str = ""
    made: dict[str, Any] = field(default_factory=dict)

    @property
    def ended(self) -> bool:
        """Whether nothing more happens to it."""
        return self.state in ("done", "failed", "cancelled")

    def plain(self) -> dict[str, Any]:
        """What the page is told."""
        return {
            "id": self.id, "session": self.session, "state": self.state, "label": self.label, "done": self.done,
            "total": self.total, "error": self.error, "made": self.made,
        }  # fmt: skip

    def tell(self, label: str, done: float, total: float) -> None:
        """Its progress. Raises CancelledError where it was cancelled, so that no further step begins."""
        if self.state == "cancelled":
            raise CancelledError
        self.label, self.done, self.total = label, done, total


class Jobs:
    """Jobs in the order in which they were asked for; a thread runs them with the worker."""

    def __init__(self, worker: Worker) -> None:
        self._worker = worker
        self._jobs: dict[str, Job] = {}
        self._waiting: Queue[Job | None] = Queue()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def add(self, session: str, work: Callable[[Told], dict[str, Any]]) -> Job:
        """Queue work for a session. Raises UsageError where too much waits."""
        with self._lock:
            if sum(not job.ended for job in self._jobs.values()) >= MOST_WAITING:
                raise UsageError("Too much work is waiting.", "Cancel some of it.")
            for old in [job for job in self._jobs.values() if job.ended][: -_MOST_KEPT or None]:
                del self._jobs[old.id]
            job = Job(session, work)
            self._jobs[job.id] = job
        self._waiting.put(job)
        return job

    def of(self, session: str) -> list[Job]:
        """A session's jobs, the oldest first."""
        with self._lock:
            return [job for job in self._jobs.values() if job.session == session]

    def named(self, session: str, job: str) -> Job:
        """Raises UsageError for a job that the session does not have."""
        found = next((each for each in self.of(session) if each.id == job), None)
        if found is None:
            raise UsageError("There is no such work.", "Load the page again.")
        return found

    def cancel(self, job: Job) -> None:
        """End a job, running or waiting."""
        with self._lock:
            if job.ended:
                return
            running = job.state == "running"
            job.state = "cancelled"
            if running:
                self._worker.cancel()  # before the next job begins, which waits for the lock

    def close(self) -> None:
        """Run no further job, and no further step of the one that runs."""
        with self._lock:
            for job in self._jobs.values():
                if not job.ended:
                    job.state = "cancelled"
        self._waiting.put(None)

    def _run(self) -> None:
        while (job := self._waiting.get()) is not None:
            with self._lock:
                if job.ended:
                    continue
                job.state = "running"
            try:
                made = job.work(job.tell)
                state, error = "done", ""
            except CancelledError:
                made, state, error = {}, "cancelled", ""
            except PumpsError as fault:
                made, state, error = {}, "failed", str(fault)
            except Exception as fault:  # a fault of pumps ends the job, not the thread
                made, state, error = {}, "failed", f"The studio failed: {type(fault).__name__}: {fault}."
            with self._lock:
                job.made, job.error = made, error
                if not job.ended:
                    job.state = state
