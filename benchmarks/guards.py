"""Run all benchmarks that guard a figure, one after another, each in one thread.

This is meant to end within ten minutes on two idle cores.

    make bench

With one thread, CPU seconds change little when other work runs on the machine. Scripts that read archives read the
clips that come with pumps.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
GUARDS = {  # script: its flags
    "synthesiser_training": (),
    "training_step": ("--rounds", "2"),
    "reading": (),
    "filling": ("--rounds", "2", "--minutes", "1", "3"),
    "durable_writes": (),
    "retargeting": (),
    "any_humanoid": ("--most", "20"),
    "body_certainty": ("--most", "4", "--creatures", "4"),
}


def main() -> None:
    began = time.perf_counter()
    for name, flags in GUARDS.items():
        print(f"== {name}", flush=True)
        command = [sys.executable, str(HERE / f"{name}.py"), *flags]
        if subprocess.run(command, env=os.environ | {"OMP_NUM_THREADS": "1"}).returncode:
            raise SystemExit(f"benchmarks/{name}.py failed; its message is above.")
    print(f"All within {time.perf_counter() - began:.0f} s.")


if __name__ == "__main__":
    main()
