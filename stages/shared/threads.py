"""Processes and threads: how many, how they start, how OpenMP's threads wait. Imports no torch, since it must be
called before torch is loaded."""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.context import BaseContext

_torch_came_first = False


def let_waiting_threads_sleep() -> None:
    """Let OpenMP's threads sleep soon while they wait, unless the environment says otherwise.

    By default they spin, and keep other work from the cores: a solve was twenty times slower beside another process.
    With no spinning at all a training step on two quiet cores takes 1.6 times as long; a few microseconds of it give
    most of that back, and cost little beside others (docs/performance.md). OpenMP reads these settings once, when
    torch is loaded; `one_thread_if_they_spin` is for programs that load torch before.
    """
    global _torch_came_first
    _torch_came_first |= "torch" in sys.modules and "OMP_WAIT_POLICY" not in os.environ
    if os.environ.setdefault("OMP_WAIT_POLICY", "passive").lower() == "passive":
        os.environ.setdefault("GOMP_SPINCOUNT", "2000")
    os.environ.setdefault("KMP_BLOCKTIME", "0")  # Intel's and LLVM's, which spin on for 200 ms all the same


@contextmanager
def one_thread_if_they_spin() -> Iterator[None]:
    """Let torch compute in one thread inside the block if it was loaded before `let_waiting_threads_sleep` ran.

    Its threads then spin, and no setting reaches them any more. On two cores that other processes also used, a fill
    took 2 to 3 s in one thread and 43 to 54 s in two that spun.
    """
    if not _torch_came_first:
        yield
        return
    torch = sys.modules["torch"]
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def process_context() -> BaseContext:
    """Processes that are not forked from this one, since a fork would copy the locks of its libraries' threads."""
    methods = multiprocessing.get_all_start_methods()
    return multiprocessing.get_context("forkserver" if "forkserver" in methods else "spawn")
