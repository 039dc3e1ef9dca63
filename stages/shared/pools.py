"""Where tasks run: in processes on this machine, or on a cluster (Dask), behind one interface, `Executor`.

A task is a function that can be pickled by its name, with arguments that can be pickled. On a cluster, workers have
the same code and see the same files under the same paths. When a worker dies, the cluster runs its tasks again on
other workers. `TaskDied` stands for the result of a task that ended several workers, or its process on this machine.
"""

from __future__ import annotations

import os
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from typing import Any, TypeVar

from data_schemas.errors import InputError, PumpsError, UsageError
from data_schemas.version import code_digest
from stages.shared.threads import process_context

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")
_CONNECT_S = 20
AHEAD = 64  # tasks of a cluster that are begun before the first of them is used: bounds the memory of results


class TaskDied:
    """In the place of a task's result: the process that ran it ended, perhaps for want of memory."""


def process_pool(count: int) -> ProcessPoolExecutor:
    """Processes on this machine, which compute in one thread each."""
    return ProcessPoolExecutor(count, mp_context=process_context(), initializer=compute_in_one_thread)


def compute_in_one_thread() -> None:
    """One thread for this process, also where torch is loaded already."""
    os.environ["OMP_NUM_THREADS"] = "1"
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)


@contextmanager
def cluster_pool(address: str) -> Iterator[Executor]:
    """The workers of a Dask scheduler, such as `tcp://host:8786`.

    Raises: UsageError where Dask is not installed, or nothing is found at the address; PumpsError where the scheduler
        is lost.
    """
    try:
        from distributed import Client
    except ImportError:
        raise UsageError("--cluster needs Dask.", "Install it: pip install 'pumps[cluster]'.") from None
    try:
        client = Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())[:160]
        raise UsageError(
            f"No Dask scheduler is found at {address} ({reason}).", "Start one with `dask scheduler`, and workers."
        ) from None
    try:
        yield _ClusterExecutor(client)
    except CancelledError:
        raise PumpsError(
            f"The scheduler at {address} was lost, or cancelled the work.", "Give the same command again to go on."
        ) from None
    finally:
        client.close()


class _ClusterExecutor(Executor):
    """Tasks sent to a Dask client, each run in this process' working directory by the same code."""

    def __init__(self, client: Any) -> None:
        self._executor = client.get_executor(pure=False)

    def submit(self, function: Callable[..., _Result], /, *args: Any, **kwargs: Any) -> Future[_Result]:
        return self._executor.submit(_run_as_here, os.getcwd(), code_digest(), function, args, kwargs)


def _run_as_here(
    folder: str, code: str, function: Callable[..., _Result], args: tuple[Any, ...], kwargs: dict[str, Any]
) -> _Result:
    """On a worker: run a task as the process that sent it would."""
    if code != code_digest():
        raise UsageError("A worker of the cluster runs other code of pumps.", "Install the same version everywhere.")
    try:
        os.chdir(folder)
    except OSError as error:
        raise UsageError(
            f"A worker of the cluster cannot enter {folder} ({error.strerror}).",
            "Its machine must share this folder.",
        ) from None
    compute_in_one_thread()
    return function(*args, **kwargs)


def result_or_death(future: Future[_Result]) -> _Result | TaskDied:
    """What a task returned, or `TaskDied`; raises what the task raised."""
    try:
        return future.result()
    except BrokenProcessPool:
        return TaskDied()
    except Exception as error:
        if type(error).__name__ == "KilledWorker":  # Dask's: the task ended several workers
            return TaskDied()
        raise


def results_in_order(
    pool: Executor | None, function: Callable[[_Task], _Result], tasks: Iterable[_Task], ahead: int = AHEAD
) -> Iterator[_Result | TaskDied]:
    """The results of tasks, in order; `TaskDied` in the place of those whose process died.

    Args:
        pool: where they run; None for here, one after another.
        ahead: how many are begun before the first of them is used.
    """
    if pool is None:
        yield from map(function, tasks)
        return
    left = iter(tasks)
    waiting = deque(pool.submit(function, task) for task in islice(left, ahead))
    while waiting:
        yield result_or_death(waiting.popleft())
        waiting.extend(pool.submit(function, task) for task in islice(left, 1))


def all_results(
    pool: Executor | None, function: Callable[[_Task], _Result], tasks: Iterable[_Task]
) -> Iterator[_Result]:
    """As `results_in_order`; raises InputError for the first task whose process died."""
    for result in results_in_order(pool, function, tasks):
        if isinstance(result, TaskDied):
            raise InputError(
                "Workers of the cluster died of one clip, perhaps for want of memory.",
                "Give workers more memory, or cut the recording into shorter ones.",
            )
        yield result


@contextmanager
def cluster_or_none(address: str | None) -> Iterator[Executor | None]:
    """The cluster at an address, or nothing where there is no address."""
    if address is None:
        yield None
        return
    with cluster_pool(address) as pool:
        yield pool
