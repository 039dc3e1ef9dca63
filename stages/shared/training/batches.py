"""Batches drawn ahead of the training step, by a thread or by several processes, always in the same order."""

from __future__ import annotations

import multiprocessing
import os
import sys
import threading
from collections import deque
from collections.abc import Callable, Generator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from itertools import islice
from typing import Any

import torch

from data_schemas.errors import PumpsError, UsageError
from stages.shared.threads import process_context
from stages.shared.training.config import TrainingConfig
from stages.shared.training.ranks import Ranks
from stages.shared.training.task import Drawer, TrainingTask, step_random

DRAW = 1  # the purpose of the generators
_drawer: Drawer | None = None  # set in a drawing process


def parts_of(config: TrainingConfig, ranks: Ranks, splits: bool) -> list[range]:
    """This process's windows of every batch, divided into the parts that it computes one after the other.

    Raises: UsageError if there are too few windows, or the task cannot be given parts of a batch.
    """
    count = ranks.count * config.accumulate
    if count > 1 and not splits:
        raise UsageError("This training cannot split its batches.", "Run it in one process, with accumulate = 1.")
    if config.batch < count:
        raise UsageError(
            f"A batch of {config.batch} windows cannot be split into {count} parts "
            f"({ranks.count} processes times accumulate = {config.accumulate}).",
            "Raise batch or lower accumulate.",
        )
    bounds = [part * config.batch // count for part in range(count + 1)]
    own = range(ranks.rank * config.accumulate, (ranks.rank + 1) * config.accumulate)
    return [range(bounds[part], bounds[part + 1]) for part in own]


def drawn_ahead(
    task: TrainingTask[Any], config: TrainingConfig, parts: list[range], first_step: int
) -> Generator[Any, None, None]:
    """The batches of all steps from `first_step` on, part by part. Draws depend on (seed, step, window) only.

    Raises: PumpsError if a drawing process dies.
    """
    steps = range(first_step, config.last_step or sys.maxsize)
    wanted = ((config.seed, step, part) for step in steps for part in parts)
    ahead: deque[Future[Any]] = deque()
    drawer = task.drawer(elsewhere=config.workers > 0)
    with _executor(drawer, config.workers) as executor:
        draw: Callable[..., Any] = partial(_draw, drawer) if config.workers == 0 else _draw_here
        try:
            # Long enough that a process continues drawing during steps that need no new batch.
            depth = max(2, 8 * config.workers)
            ahead.extend(executor.submit(draw, *unit) for unit in islice(wanted, depth))
            while ahead:
                batch = ahead.popleft().result()
                ahead.extend(executor.submit(draw, *unit) for unit in islice(wanted, 1))
                yield batch
        except BrokenProcessPool:
            raise PumpsError(
                "A process that draws batches died, perhaps for lack of memory.", "Lower workers or cache_mb."
            ) from None
        finally:
            executor.shutdown(wait=False, cancel_futures=True)


def _draw(drawer: Drawer, seed: int, step: int, part: range) -> Any:
    return drawer.draw(step_random(seed, DRAW, step, part))


def _executor(drawer: Drawer, workers: int) -> Executor:
    if workers == 0:
        return ThreadPoolExecutor(1)
    return ProcessPoolExecutor(workers, process_context(), initializer=_begin, initargs=(drawer,))


def _begin(drawer: Drawer) -> None:
    global _drawer
    _drawer = drawer
    torch.set_num_threads(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    # If the training is killed, its drawing processes must end too.
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _draw_here(seed: int, step: int, part: range) -> Any:
    assert _drawer is not None
    return _draw(_drawer, seed, step, part)
