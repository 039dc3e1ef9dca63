"""Run all benchmarks that guard a figure, one after another, each in one thread.

This is meant to end within ten minutes on two idle cores.

    make bench
    make bench PAGE=docs/performance.md    also writes three tables of that page

With one thread, CPU seconds change little when other work runs on the machine. Scripts that read archives read the
clips that come with pumps.
"""

from __future__ import annotations

import argparse
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
    "filling": ("--rounds", "2", "--minutes", "1", "10"),
    "durable_writes": (),
    "retargeting": (),
    "any_humanoid": ("--most", "20"),
    "body_certainty": ("--most", "4", "--creatures", "4"),
}
ON_THE_PAGE = {"synthesiser_training", "training_step", "filling"}  # tables of the same cases as here


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--page", help="the page whose tables are written anew")
    page = parser.parse_args().page
    began = time.perf_counter()
    for name, flags in GUARDS.items():
        print(f"== {name}", flush=True)
        command = [
            sys.executable,
            str(HERE / f"{name}.py"),
            *flags,
            *(["--page", page] if page and name in ON_THE_PAGE else []),
        ]
        if subprocess.run(command, env=os.environ | {"OMP_NUM_THREADS": "1"}).returncode:
            raise SystemExit(f"benchmarks/{name}.py failed; its message is above.")
    print(f"All within {time.perf_counter() - began:.0f} s.")


if __name__ == "__main__":
    main()
