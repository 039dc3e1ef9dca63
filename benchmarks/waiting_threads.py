"""Time a training step with threads that spin while they wait, spin a little, or sleep at once (docs/performance.md).

    python benchmarks/waiting_threads.py

Each in a process of its own, since OpenMP reads its settings once. Run it on quiet cores, and beside other work.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time

WAYS = {
    "spin": {"OMP_WAIT_POLICY": "active"},
    "as pumps sets it": {"OMP_WAIT_POLICY": "passive", "GOMP_SPINCOUNT": "2000"},
    "sleep at once": {"OMP_WAIT_POLICY": "passive"},
    "one thread": {"OMP_NUM_THREADS": "1"},
}
NAMES = ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT", "OMP_NUM_THREADS")
STEPS = 5


def main() -> None:
    if sys.argv[1:] == ["step"]:
        print(f"{least_step_s():.2f}")
        return
    kept = {name: value for name, value in os.environ.items() if name not in NAMES}
    print("| threads that wait | least of five steps, s |\n|---|---:|")
    for way, settings in WAYS.items():
        told = subprocess.run(
            [sys.executable, __file__, "step"], env={**kept, **settings}, capture_output=True, text=True, check=True
        )
        print(f"| {way} | {told.stdout.strip()} |", flush=True)


def least_step_s() -> float:
    """Of the preset `paper`'s autoencoder, two sequences, in bfloat16."""
    import torch
    from measuring.steps import Load, autoencoder_step
    from training_step import settings_of

    config = settings_of("paper")[0]
    config = config.model_copy(update={"decoder": config.decoder.model_copy(update={"layers": 4})})
    step = autoencoder_step(Load(2, 128, 256, torch.device("cpu")), config)
    seconds = []
    for _ in range(STEPS + 1):
        start = time.perf_counter()
        step()
        seconds.append(time.perf_counter() - start)
    return min(seconds[1:])


if __name__ == "__main__":
    main()
