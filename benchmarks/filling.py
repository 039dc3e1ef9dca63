"""What `pumps infill` costs: CPU seconds by part beside the limits of the machine, start-up, and memory.

    OMP_NUM_THREADS=1 python benchmarks/filling.py [--rounds 3] [--minutes 1 10] [--page docs/performance.md]

It fills the clips that come with pumps, one after another until the clip is long enough, with a key every 15 frames
and the default weights. `--minutes 1 10 60` also measures the memory of an hour, which takes a quarter of an hour.
Each part stands beside its limit: the time that its products, or what it reads and writes, would take at the rates
that this machine reaches in the same rounds. Seconds are CPU seconds.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import torch
from measuring.counting import Work, work_of
from measuring.machine import limits, name_of
from measuring.page import limit_cells, limit_of
from measuring.section import replace_section

import stages.shared.clips
from stages.infill.config import Config
from stages.infill.run import run as infill
from stages.shared.inference import filling
from stages.shared.inference.models import Autoencoder, Models

HERE = Path(__file__).resolve().parent.parent
CPU, FPS, KEYS = torch.device("cpu"), 30, "every:15"
# A part of filling, and what computes it: the attribute that is replaced by a measured one.
PARTS = {
    "encode": (Autoencoder, "encode"),
    "synthesise": (Models, "synthesise"),
    "decode": (Autoencoder, "decode"),
    "solve": (filling, "solve_pose"),
    "hold the feet": (filling, "lock_feet"),
}
# Runs `pumps` with the arguments and prints its peak memory, in megabytes.
PEAK = """
import sys
from pathlib import Path
from pumps_cli.app import main
try:
    main(sys.argv[1:])
except SystemExit as leaving:
    assert not leaving.code, leaving.code
status = Path("/proc/self/status").read_text()
print(int(status.split("VmHWM:")[1].split()[0]) / 1e3)
"""


def clip_of(frames: int, path: Path) -> Path:
    """A BVH of so many frames: the rows of the clips that come with pumps, again and again."""
    head, rows = "", []
    for clip in sorted(Path(stages.shared.clips.__path__[0]).glob("*.bvh")):
        own_head, _, motion = clip.read_text(encoding="utf-8").partition("MOTION\n")
        head = head or own_head
        if own_head == head:
            rows += motion.splitlines()[2:]
    rows = (rows * (frames // len(rows) + 1))[:frames]
    text = f"{head}MOTION\nFrames: {frames}\nFrame Time: {1 / FPS:.7f}\n"
    path.write_text(text + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def fill(clip: Path) -> None:
    """Fill a clip in this process."""
    settings = {"input": clip, "output": clip.with_suffix(".filled.bvh"), "keyframes": KEYS, "overwrite": True}
    infill(Config.model_validate(settings | {"device": "cpu"}))


def seconds_of_parts(run: Callable[[], None]) -> dict[str, float]:
    """CPU seconds of each part in one run, of the rest, and of all."""
    spent = dict.fromkeys(PARTS, 0.0)

    def measured(name: str, work: Callable[..., Any]) -> Callable[..., Any]:
        def call(*given: Any, **named: Any) -> Any:
            began = time.process_time()
            try:
                return work(*given, **named)
            finally:
                spent[name] += time.process_time() - began

        return call

    began = time.process_time()
    replaced(measured, run)
    whole = time.process_time() - began
    return spent | {"all else": whole - sum(spent.values()), "whole": whole}


def work_of_parts(run: Callable[[], None]) -> dict[str, Work]:
    """Operations and bytes of each part in one run."""
    counted = {name: Work(0.0, 0.0, 0.0, []) for name in PARTS}

    def measured(name: str, work: Callable[..., Any]) -> Callable[..., Any]:
        def call(*given: Any, **named: Any) -> Any:
            made: list[Any] = []
            own = work_of(lambda: made.append(work(*given, **named)), CPU)
            before = counted[name]
            counted[name] = Work(before.gflop + own.gflop, before.gb + own.gb, 0.0, [])
            return made[0]

        return call

    replaced(measured, run)
    return counted


def replaced(measured: Callable[[str, Callable[..., Any]], Callable[..., Any]], run: Callable[[], None]) -> None:
    """Run with every part replaced by a measured one."""
    patches = [
        mock.patch.object(owner, attribute, measured(name, getattr(owner, attribute)))
        for name, (owner, attribute) in PARTS.items()
    ]
    for patch in patches:
        patch.start()
    try:
        run()
    finally:
        for patch in patches:
            patch.stop()


def child(*words: str) -> tuple[float, str]:
    """CPU seconds of a new interpreter with these arguments, and what it printed."""
    environment = os.environ | {"PYTHONPATH": str(HERE), "OMP_NUM_THREADS": "1"}
    before = os.times()
    told = subprocess.run([sys.executable, *words], env=environment, capture_output=True, text=True, check=True)
    after = os.times()
    spent = after.children_user + after.children_system - before.children_user - before.children_system
    return spent, told.stdout


def words_of_infill(clip: Path) -> list[str]:
    output = str(clip.with_suffix(".filled.bvh"))
    return ["infill", str(clip), "--keyframes", KEYS, "-o", output, "--overwrite", "--quiet", "--device", "cpu"]


def table_of_parts(clip: Path, seconds: int, rounds: int) -> list[str]:
    meters = limits(CPU)
    rates = dict.fromkeys(meters, 0.0)
    fill(clip)
    found = []
    for _ in range(rounds):
        rates = {name: max(rates[name], meter()) for name, meter in meters.items()}
        found.append(seconds_of_parts(lambda: fill(clip)))
    least = min(found, key=lambda each: each["whole"])
    work = work_of_parts(lambda: fill(clip))
    products = sum(each.gflop for each in work.values())
    rate = rates["matrix_float32_gflop_per_s"]
    lines = [
        f"{seconds} s of motion at {FPS} frames a second, a key every 15 frames, models loaded, files read and "
        f"written: **{least['whole']:.2f} CPU s**. {name_of(CPU)}, {torch.get_num_threads()} threads, PyTorch "
        f"{torch.__version__}; the fastest of {rounds} rounds. Its {products:.0f} GFLOP would take "
        f"{products / rate:.2f} s, {100 * products / rate / least['whole']:.0f} % of that, at the {rate:.0f} GFLOP/s "
        "of a large float32 product in the same rounds.",
        "",
        "| part | CPU s | share | GFLOP | GB moved | limit | at the limit, s | reached |",
        "|---|---:|---:|---:|---:|---|---:|---:|",
    ]
    for name in (*PARTS, "all else"):
        cells = [name, f"{least[name]:.2f}", f"{100 * least[name] / least['whole']:.0f} %"]
        if name in work and work[name].gb >= 0.05:  # the feet are held in NumPy, whose operations are not counted
            limit = limit_of(work[name].gflop, work[name].gb, rates, bfloat16=False)
            cells += [f"{work[name].gflop:.1f}", f"{work[name].gb:.1f}", *limit_cells(limit, least[name])]
        else:
            cells += [""] * 5
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def line_of_start(clip: Path, rounds: int) -> str:
    torch_s, whole_s = [], []
    for _ in range(rounds):
        torch_s.append(child("-c", "import torch")[0])
        whole_s.append(child("-m", "pumps_cli", *words_of_infill(clip))[0])
    one, other = min(torch_s), min(whole_s)
    return (
        f"A 4 s clip as a whole process: {other:.2f} CPU s; `import torch` alone {one:.2f}. The goal is 1.5 times "
        f"that plus 1.3 s, {1.5 * one + 1.3:.2f}."
    )


def table_of_memory(folder: Path, minutes: list[int]) -> list[str]:
    lines = ["| minutes | peak MB | CPU s, whole process |", "|---:|---:|---:|"]
    for count in minutes:
        clip = clip_of(60 * FPS * count, folder / f"{count}.bvh")
        spent, told = child("-c", PEAK, *words_of_infill(clip))
        lines.append(f"| {count} | {float(told.split()[-1]):.0f} | {spent:.0f} |")
        print(lines[-1], file=sys.stderr)
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=int, default=60, help="of the clip whose parts are timed")
    parser.add_argument("--minutes", type=int, nargs="*", default=[1, 3], help="clips whose memory is measured")
    parser.add_argument("--page", type=Path, help="a page to write the tables into, between its markers")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        lines = table_of_parts(clip_of(FPS * options.seconds, folder / "clip.bvh"), options.seconds, options.rounds)
        lines += ["", line_of_start(clip_of(4 * FPS, folder / "short.bvh"), options.rounds)]
        if options.minutes:
            lines += ["", *table_of_memory(folder, options.minutes)]
    print("\n".join(lines))
    if options.page:
        replace_section(options.page, "filling", "\n".join(lines))


if __name__ == "__main__":
    main()
