"""Time training steps and the encoder of two checkouts of this project in turn: what a change gave.

    git worktree add ../before COMMIT
    OMP_NUM_THREADS=1 python benchmarks/two_versions.py ../before [--rounds 4] [--page docs/performance.md]

Each checkout's steps are built by its own code, in a process of its own; only one of the two computes at any time.
Seconds are those of the processor, which other work on the machine changes little with one thread.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
from pathlib import Path

from measuring.section import replace_section

HERE = Path(__file__).resolve().parent.parent
# Preset, sequences, then the arguments of `training_step.Case`: kind, neighbours, layers, head, mixed.
CASES = {
    "encoder forward, k=8, float32": ("paper", 2, "encoder", 8, 0, "mlp", False),
    "encoder forward, k=8, bfloat16": ("paper", 2, "encoder", 8, 0, "mlp", True),
    "autoencoder step, k=16, 4 layers": ("paper", 2, "ae", 16, 4, "mlp", True),
    "autoencoder step, k=16, 16 layers": ("paper", 2, "ae", 16, 16, "mlp", True),
    "synthesiser step, k=16": ("paper", 2, "lms", 16, 0, "mlp", True),
    "`tiny`, autoencoder step of 16 windows": ("tiny", 16, "ae", 8, 3, "skinning", True),
    "`tiny`, synthesiser step of 16 windows": ("tiny", 16, "lms", 8, 0, "mlp", True),
}
# What a checkout's process runs: it takes the number of a case from each line, and answers with seconds.
STEPS = """
import sys, time
root = sys.argv[1]
sys.path[:0] = [root, root + "/benchmarks"]
import torch, stages, training_step as own
assert stages.__path__[0].startswith(root), stages.__path__
steps = []
for preset, sequences, *case in eval(sys.argv[2]):
    ae, lms = own.settings_of(preset)
    load = own.Load(sequences, ae.window, ae.points, torch.device("cpu"))
    steps.append(own.build(own.Case(*case), load, ae, lms))
    steps[-1]()
print("ready", flush=True)
for line in sys.stdin:
    began = time.process_time()
    steps[int(line)]()
    print(time.process_time() - began, flush=True)
"""


def started(root: Path) -> subprocess.Popen[str]:
    """A process that has built and warmed all cases of a checkout."""
    command = [sys.executable, "-c", STEPS, str(root.resolve()), repr(list(CASES.values()))]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    if answer(process) != "ready":
        raise SystemExit(f"The steps of {root} could not be built; its own words stand above.")
    return process


def answer(process: subprocess.Popen[str], line: str = "") -> str:
    """What the process says next, after it was told `line`."""
    assert process.stdin and process.stdout
    if line:
        process.stdin.write(f"{line}\n")
        process.stdin.flush()
    return process.stdout.readline().strip()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path, nargs="?", help="the other checkout")
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--page", type=Path, help="a page to write the table into, between its markers")
    options = parser.parse_args()
    if options.before is None:
        print("Give another checkout of this project to compare with.")
        return
    processes = [started(options.before), started(HERE)]
    lines = [
        "| CPU seconds, least of the rounds | before | after | ratio | ratio of medians |",
        "|---|---:|---:|---:|---:|",
    ]
    for index, name in enumerate(CASES):
        times: tuple[list[float], list[float]] = ([], [])
        for _ in range(options.rounds):
            for process, found in zip(processes, times, strict=True):
                found.append(float(answer(process, str(index))))
        least, middle = ([how(found) for found in times] for how in (min, statistics.median))
        ratios = f"{least[0] / least[1]:.2f} | {middle[0] / middle[1]:.2f}"
        lines.append(f"| {name} | {least[0]:.3f} | {least[1]:.3f} | {ratios} |")
        print(lines[-1], file=sys.stderr)
    for process in processes:
        process.communicate()
    print("\n".join(lines))
    if options.page:
        replace_section(options.page, "two versions", "\n".join(lines))


if __name__ == "__main__":
    main()
