"""One process that runs stages with warm models. Killing it is how a fill is cancelled."""

from __future__ import annotations

import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from data_schemas.errors import InputError, PumpsError, UsageError
from stages.registry import stage_named
from stages.shared.contract import StageConfig, StageReport
from stages.shared.settings.layers import Layer, settle
from stages.shared.threads import process_context

Told = Callable[[str, float, float], None]  # label, steps done, steps in all (0: not known)
_KINDS = {kind.__name__: kind for kind in (PumpsError, InputError, UsageError)}
_CLIP = Path(__file__).resolve().parents[1] / "shared" / "clips" / "kick.bvh"


class CancelledError(Exception):
    """The work was cancelled."""


def config_of(stage: str, values: dict[str, Any]) -> StageConfig:
    """The config of a stage. Raises UsageError for values that it does not take."""
    found = stage_named(stage)
    return settle(found.config_type(), [Layer("studio", values)], what=" ".join(("pumps", *found.command)))


class Worker:
    """Runs one stage at a time, in a process of its own, which starts when it is first needed.

    weights, device: what `start` warms the process with.
    """

    def __init__(self, weights: str, device: str) -> None:
        self._settings = (weights, device)
        self._lock = threading.Lock()
        self._cancelled = self._closed = False
        self._process: Any = None
        self._connection: Any = None

    def start(self) -> None:
        """Start the process with warm models, before the first work comes; no second one."""
        with self._lock:
            if self._process is None and not self._closed:
                self._start(warm=True)

    def run(self, stage: str, values: dict[str, Any], told: Told) -> StageReport:
        """Run a stage and wait for it.

        Raises: PumpsError as the stage does; CancelledError where `cancel` was called meanwhile, or by `told`.
        """
        with self._lock:
            if self._process is None or not self._process.is_alive():
                self._start(warm=False)  # the work itself loads what it needs
            self._cancelled = False
            process: Any = self._process
            connection = self._connection
        try:
            connection.send((stage, values))
            while True:
                kind, *rest = connection.recv()
                if kind == "told":
                    told(*rest)
                elif kind == "done":
                    return StageReport.model_validate(rest[0])
                else:
                    raise _KINDS.get(rest[0], PumpsError)(rest[1], rest[2])
        except CancelledError:  # by `told`: what the process still sends must not answer the next call
            with self._lock:
                if self._process is process:
                    self._end()
            raise
        except (EOFError, OSError):
            process.join()
            if self._cancelled:
                raise CancelledError from None
            raise PumpsError("The process that computes ended.", "Is there enough memory?") from None

    def cancel(self) -> None:
        """End what is running, and start a process for what comes next."""
        with self._lock:
            self._cancelled = True
            self._end()
            self._start(warm=True)

    def close(self) -> None:
        """End the process."""
        with self._lock:
            self._closed = True
            self._end()

    def _start(self, *, warm: bool) -> None:
        context: Any = process_context()
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_work, args=(theirs, *self._settings, warm), daemon=True)
        self._process.start()
        theirs.close()

    def _end(self) -> None:
        if self._process is None:
            return
        self._process.kill()
        self._process.join()
        self._connection.close()


class _Told:
    """A stage's `Progress` that sends what it is told through a pipe."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._label, self._done, self._total = "", 0.0, 0.0

    def start(self, label: str, total: float | None = None) -> None:
        self._label, self._done, self._total = label, 0.0, total or 0.0
        self._send()

    def advance(self, steps: float = 1, note: str = "") -> None:
        self._done += steps
        self._send()

    def message(self, text: str) -> None: ...

    def _send(self) -> None:
        self._connection.send(("told", self._label, self._done, self._total))


def _work(connection: Connection, weights: str, device: str, warm: bool) -> None:
    """The process: warm the models if asked, then run what is asked until the other end closes."""
    if warm:
        _warm(weights, device)
    while True:
        try:
            stage, values = connection.recv()
        except (EOFError, OSError, KeyboardInterrupt):
            return
        try:
            report = stage_named(stage).runner()(config_of(stage, values), progress=_Told(connection))
            answer = ("done", report.model_dump(mode="json"))
        except PumpsError as error:
            answer = ("failed", type(error).__name__, error.message, error.hint)
        except KeyboardInterrupt:
            return
        except Exception as error:  # a fault of pumps is told, and the process goes on
            answer = ("failed", "PumpsError", f"`pumps {stage}` failed: {type(error).__name__}: {error}.", None)
        try:
            connection.send(answer)
        except OSError:
            return


def _warm(weights: str, device: str) -> None:
    """Fill a short clip once, so that the first fill of the user's waits for no loading.

    An error is ignored here: that fill meets it again, and reports it.
    """
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        values = {
            "input": _CLIP, "output": Path(folder) / "warm.bvh", "keyframes": "every:15", "weights": weights,
            "device": device,
        }  # fmt: skip
        try:
            stage_named("infill").runner()(config_of("infill", values))
        except Exception:
            return
