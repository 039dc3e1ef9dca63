"""How OpenMP's threads wait. Imports no torch, since it must be called before torch is loaded."""

from __future__ import annotations

import os


def let_waiting_threads_sleep() -> None:
    """Let OpenMP's threads sleep soon while they wait, unless the environment says otherwise.

    By default they spin, and keep other work from the cores: a solve was twenty times slower beside another process.
    With no spinning at all a training step on two quiet cores takes 1.6 times as long; a few microseconds of it give
    most of that back, and cost little beside others (docs/performance.md). OpenMP reads these settings once, when
    torch is loaded.
    """
    if os.environ.setdefault("OMP_WAIT_POLICY", "passive").lower() == "passive":
        os.environ.setdefault("GOMP_SPINCOUNT", "2000")
    os.environ.setdefault("KMP_BLOCKTIME", "0")  # Intel's and LLVM's, which spin on for 200 ms all the same
