"""Time two checkouts of this project in turn: which figures a change improved, and which fell.

    make bench-compare BASE=COMMIT
    OMP_NUM_THREADS=1 python benchmarks/two_versions.py --base COMMIT [--rounds 4] [--only filling laptop]
        [--page docs/performance.md]

Each checkout's cases are built by its own code, in a process of its own. Only one of the two computes at any time,
and which one goes first changes from round to round. Seconds are those of the processor, which other work on the
machine changes little with one thread. A case that a checkout cannot build is named and left out. The exit code is 1
if a case takes more than `--most` times (1.1) as long as before, by the least and by the median of the rounds.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
from pathlib import Path

from measuring.checkouts import checked_out
from measuring.section import replace_section

HERE = Path(__file__).resolve().parent.parent
STEP = "training_step_of({})"
# What builds a case, in the names of `BUILDERS`, in each checkout: a function without arguments.
CASES = {
    "encoder forward, k=8, float32": STEP.format("'paper', 2, 'encoder', 8, 0, 'mlp', False"),
    "encoder forward, k=8": STEP.format("'paper', 2, 'encoder', 8, 0, 'mlp', True"),
    "autoencoder step, k=8, 4 layers": STEP.format("'paper', 1, 'ae', 8, 4, 'mlp', True"),
    "autoencoder step, k=16, 16 layers": STEP.format("'paper', 1, 'ae', 16, 16, 'mlp', True"),
    "synthesiser step, k=16": STEP.format("'paper', 1, 'lms', 16, 0, 'mlp', True"),
    "`laptop`, autoencoder step of 16 windows": STEP.format("'laptop', 16, 'ae', 8, 3, 'skinning', True"),
    "`laptop`, synthesiser step of 16 windows": STEP.format("'laptop', 16, 'lms', 8, 0, 'mlp', True"),
    "reading a BVH, 200 times": "reading(200)",
    "filling 5 s, keys every 15 frames": "filling(keyframes='every:15')",
    "filling 60 s, keys every 12 frames": "filling(frames=list(range(0, 1824, 12)))",
}
BUILDERS = """
from pathlib import Path
import torch, pumps, stages.shared.clips, training_step as own
from stages.shared.formats.bvh import read_bvh

CLIP = Path(stages.shared.clips.__path__[0]) / "dance_b.bvh"

def training_step_of(preset, sequences, *case):
    ae, lms = own.settings_of(preset)
    load = own.Load(sequences, ae.window, ae.points, torch.device("cpu"))
    return own.build(own.Case(*case), load, ae, lms)

def reading(times):
    text = CLIP.read_bytes()
    return lambda: [read_bvh(text, CLIP.name) for _ in range(times)]

def filling(**keys):
    clip = pumps.load(CLIP)
    return lambda: pumps.infill(clip, device="cpu", **keys)
"""
# What a checkout's process runs: it takes the number of a case from each line, and answers with seconds.
SERVER = """
import sys, time
root = sys.argv[1]
sys.path[:0] = [root, root + "/benchmarks"]
import stages
assert stages.__path__[0].startswith(root), stages.__path__
exec(sys.argv[2])
cases = []
for source in eval(sys.argv[3]):
    try:
        case = eval(source)
        case()
        cases.append(case)
        print("ready", flush=True)
    except Exception as error:
        cases.append(None)
        print(f"{type(error).__name__}: {error}".replace(chr(10), " "), flush=True)
for line in sys.stdin:
    began = time.process_time()
    cases[int(line)]()
    print(time.process_time() - began, flush=True)
"""


def started(root: Path, cases: dict[str, str]) -> subprocess.Popen[str]:
    """A process of a checkout, which builds its cases."""
    command = [sys.executable, "-c", SERVER, str(root.resolve()), BUILDERS, repr(list(cases.values()))]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def answer(process: subprocess.Popen[str], line: str = "") -> str:
    """The next line of a process, after it was given `line`.

    Raises: SystemExit if the process has ended.
    """
    assert process.stdin and process.stdout
    if line:
        process.stdin.write(f"{line}\n")
        process.stdin.flush()
    found = process.stdout.readline().strip()
    if not found:
        raise SystemExit("A checkout's process ended early; its message is above.")
    return found


def comparison(before: Path, cases: dict[str, str], rounds: int, most: float) -> tuple[list[str], list[str]]:
    """The table's lines, and the names of the cases that take more than `most` times as long as before."""
    processes = [started(root, cases) for root in (before, HERE)]
    lines = [
        "| CPU seconds, least of the rounds | before | after | ratio | ratio of medians | |",
        "|---|---:|---:|---:|---:|---|",
    ]
    slower = []
    built = [[answer(process) for _ in cases] for process in processes]
    for index, name in enumerate(cases):
        faults = [found[index] for found in built if found[index] != "ready"]
        if faults:
            print(f"{name}: left out, a checkout cannot build it: {faults[0]}", file=sys.stderr)
            continue
        times: tuple[list[float], list[float]] = ([], [])
        for turn in range(rounds):
            pairs = list(zip(processes, times, strict=True))
            for process, found in pairs if turn % 2 == 0 else pairs[::-1]:
                found.append(float(answer(process, str(index))))
        least, middle = ([how(found) for found in times] for how in (min, statistics.median))
        ratios = least[0] / least[1], middle[0] / middle[1]
        fell = max(ratios) < 1 / most
        slower += [name] * fell
        note = "slower" if fell else ""
        lines.append(f"| {name} | {least[0]:.3f} | {least[1]:.3f} | {ratios[0]:.2f} | {ratios[1]:.2f} | {note} |")
        print(lines[-1], file=sys.stderr, flush=True)
    for process in processes:
        process.communicate()
    return lines, slower


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--base", required=True, help="the commit to compare with")
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--most", type=float, default=1.1, help="times as long as before that is no fault")
    parser.add_argument("--only", nargs="*", default=[""], help="words: the cases whose names hold one of them")
    parser.add_argument("--page", type=Path, help="a page to write the table into, between its markers")
    options = parser.parse_args()
    cases = {name: source for name, source in CASES.items() if any(word in name for word in options.only)}
    if not cases:
        raise SystemExit(f"No case is named by {' '.join(options.only)}; the cases are: {'; '.join(CASES)}.")
    with checked_out(options.base) as before:
        lines, slower = comparison(before, cases, options.rounds, options.most)
    print("\n".join(lines))
    if options.page:
        replace_section(options.page, "two versions", "\n".join(lines))
    if slower:
        raise SystemExit(f"Slower by more than {100 * (options.most - 1):.0f} %: {'; '.join(slower)}.")


if __name__ == "__main__":
    main()
