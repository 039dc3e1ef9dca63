"""Time training steps at the sizes of a preset, beside what the machine can do and, if given, another implementation.

    make bench-train [PRESET=paper] [BATCH=2] [DEVICE=cuda] [AUTHORS=adapter.py]
    python benchmarks/training_step.py [--json] [--rounds 3] [--page docs/performance.md] [--compile]

All cases are built in one process and timed in turn, round after round, and so are a matrix product and copies of
memory. One more step of each case is counted, and two are taken in a fresh process for their peak memory. The table
gives the time that a step's products, or what it reads and writes, would take at the measured rates (the longer of
the two is the limit), and the share of that limit that the step reaches. Progress goes to standard error.

AUTHORS is a Python file with `make_step(sequences, frames, points, layers)`, which returns a function that takes one
training step of another implementation (for instance the released PUMPS code, which does not run without changes).
Its steps are timed in the same rounds.
"""

from __future__ import annotations

import argparse
import json
import os
import runpy
import statistics
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_all_start_methods, get_context
from pathlib import Path
from typing import Any

import torch
from measuring.counting import Work, waits_in, work_of
from measuring.machine import cpu_and_wall_s, limits, name_of, resident_mb, seconds_of
from measuring.page import report, write_page
from measuring.steps import Load, autoencoder_step, encoder_forward, synthesiser_step

from stages.registry import stage_named
from stages.shared.networks.layers.device import choose_device, computes_bfloat16
from stages.shared.settings.layers import Layer, settle
from stages.shared.settings.presets import preset_layers


@dataclass(frozen=True)
class Case:
    """One thing to time. kind: encoder, ae or lms."""

    kind: str
    neighbours: int
    layers: int = 0
    head: str = "mlp"
    mixed: bool = True
    checkpointing: bool = False
    compiled: bool = False

    @property
    def name(self) -> str:
        words = {"encoder": "encoder forward", "ae": "autoencoder step", "lms": "synthesiser step"}
        parts = [f"{words[self.kind]}, k={self.neighbours}"]
        parts += [f"{self.layers} layers, {self.head}"] if self.kind == "ae" else []
        parts += ["bfloat16" if self.mixed else "float32"]
        parts += ["checkpointing"] * self.checkpointing + ["compiled"] * self.compiled
        return ", ".join(parts)


def cases_of(preset: str, settings: Any, compiled: bool, bfloat16: bool) -> list[Case]:
    """At the paper's sizes: both k, 4 and 16 layers, both heads, both precisions. Elsewhere the preset's own.

    bfloat16: whether the device computes the networks in it; without, each case is timed once, in float32.
    """
    cases = _all_cases(preset, settings, compiled)
    return list(dict.fromkeys(case if bfloat16 else replace(case, mixed=False) for case in cases))


def _all_cases(preset: str, settings: Any, compiled: bool) -> list[Case]:
    own = (settings.encoder.neighbours, settings.decoder.layers, settings.decoder.head)
    if preset != "paper":
        cases = [Case("ae", *own), Case("ae", *own, mixed=False), Case("encoder", own[0]), Case("lms", own[0])]
        return cases + [Case("ae", *own, compiled=True)] * compiled
    cases = [Case("ae", k, layers) for k in (16, 8) for layers in (4, 16)]
    cases += [Case("ae", 16, 4, mixed=False), Case("ae", 16, 4, "skinning"), Case("ae", 16, 4, checkpointing=True)]
    cases += [Case("encoder", 8, mixed=False), Case("encoder", 8), Case("encoder", 16), Case("lms", 16)]
    return cases + [Case("ae", 16, 4, compiled=True)] * compiled


def build(case: Case, load: Load, ae: Any, lms: Any) -> Callable[[], object]:
    """The step of a case."""
    encoder = ae.encoder.model_copy(update={"neighbours": case.neighbours})
    if case.kind == "encoder":
        return encoder_forward(load, encoder, mixed=case.mixed)
    mixed = {"mixed_precision": case.mixed}
    if case.kind == "lms":
        frozen = ae.model_copy(update={"encoder": encoder})
        return synthesiser_step(load, frozen, lms.model_copy(update=mixed), checkpointing=case.checkpointing)
    decoder = ae.decoder.model_copy(update={"layers": case.layers, "head": case.head})
    config = ae.model_copy(update={"encoder": encoder, "decoder": decoder, **mixed})
    return autoencoder_step(load, config, checkpointing=case.checkpointing, compiled=case.compiled)


def settings_of(preset: str) -> tuple[Any, Any]:
    """The preset's settings of both trainings."""
    found = []
    for stage in ("train-ae", "train-lms"):
        here = Layer("here", {"tpc": "none", "output": "none"} | ({"ae": "none"} if stage == "train-lms" else {}))
        layers = [*preset_layers(preset, stage), here]
        found.append(settle(stage_named(stage).config_type(), layers, what="the benchmark"))
    return found[0], found[1]


def peak_mb(case: Case, preset: str, load: Load, threads: int) -> float:
    """Memory that two steps of a case take: on a GPU its own peak, on a CPU this (fresh) process's, less what it had
    before the networks were made."""
    torch.set_num_threads(threads)
    before = resident_mb()[0]
    if load.device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(load.device)
    step = build(case, load, *settings_of(preset))
    step()
    step()
    if load.device.type == "cuda":
        return torch.cuda.max_memory_allocated(load.device) / 1e6
    return resident_mb()[1] - before


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """All figures, by name."""
    began = time.perf_counter()
    device = choose_device(options.device)
    ae, lms = settings_of(options.preset)
    load = Load(options.batch or ae.batch, ae.window, ae.points, device)
    cases = cases_of(options.preset, ae, options.compile, computes_bfloat16(device))
    steps = {case.name: build(case, load, ae, lms) for case in cases}
    if options.authors:
        make_step = runpy.run_path(options.authors)["make_step"]
        for layers in sorted({case.layers for case in cases if case.layers}):
            steps[f"authors, {layers} layers"] = make_step(load.sequences, load.frames, load.points, layers)
    _tell(began, f"{len(steps)} cases built")
    first = {name: seconds_of(step, device) for name, step in steps.items()}  # warm-up; with --compile, compilation
    _tell(began, "warm")
    meters = limits(device)
    seconds: dict[str, list[float]] = {name: [] for name in steps}
    cpu_seconds: dict[str, list[float]] = {name: [] for name in steps}
    rates: dict[str, list[float]] = {name: [] for name in meters}
    for done in range(options.rounds):
        for name, meter in meters.items():
            rates[name].append(meter())
        for name, step in steps.items():
            spent, took = cpu_and_wall_s(step, device)
            cpu_seconds[name].append(spent)
            seconds[name].append(took)
        _tell(began, f"round {done + 1} of {options.rounds}")
    rows = []
    for case in cases:
        step, times = steps.pop(case.name), seconds[case.name]
        work = None if case.compiled else work_of(step, device)
        row = {"name": case.name, **asdict(case), "first_s": first[case.name], "least_s": min(times)}
        row |= {"median_s": statistics.median(times), "least_cpu_s": min(cpu_seconds[case.name])}
        row |= asdict(work) if work else dict.fromkeys(Work.__dataclass_fields__)
        row |= {"waits": waits_in(step, device), "authors_s": _authors_s(case, seconds)}
        rows.append(row)
    _tell(began, "counted")
    for case, row in zip(cases, rows, strict=True):
        row["peak_mb"] = _in_a_fresh_process(case, options.preset, load)
    _tell(began, "memory taken")
    return {
        "preset": options.preset,
        "device": device.type,
        "machine": name_of(device),
        "threads": torch.get_num_threads(),
        "wait_policy": os.environ.get("OMP_WAIT_POLICY", ""),
        "torch": torch.__version__,
        "sequences": load.sequences,
        "frames": load.frames,
        "points": load.points,
        "rounds": options.rounds,
        "seconds": time.perf_counter() - began,
        "limits": {name: max(values) for name, values in rates.items()},
        "cases": rows,
    }


def _in_a_fresh_process(case: Case, preset: str, load: Load) -> float:
    """`peak_mb` in a process that has loaded PyTorch and computed nothing."""
    cheap = "forkserver" in get_all_start_methods() and load.device.type == "cpu"
    context = get_context("forkserver" if cheap else "spawn")
    if cheap:
        context.set_forkserver_preload(["torch"])  # once, and not for every case
    with ProcessPoolExecutor(1, mp_context=context) as fresh:
        return fresh.submit(peak_mb, case, preset, load, torch.get_num_threads()).result()


def _tell(began: float, what: str) -> None:
    print(f"{time.perf_counter() - began:6.1f} s  {what}", file=sys.stderr, flush=True)


def _authors_s(case: Case, seconds: dict[str, list[float]]) -> float | None:
    """Seconds of the other implementation's step with as many layers, from the same rounds."""
    here = seconds.get(f"authors, {case.layers} layers")
    return min(here) if here else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", default="paper")
    parser.add_argument("--batch", type=int, default=2, help="sequences in a step; 0 for the preset's own")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--authors", default="", help="a Python file with make_step (see above)")
    parser.add_argument("--compile", action="store_true", help="one more case, with torch.compile")
    parser.add_argument("--json", action="store_true", help="one line of numbers")
    parser.add_argument("--page", type=Path, help="a page to write the tables into, between its markers")
    options = parser.parse_args()
    figures = measure(options)
    if options.json:
        print(json.dumps(figures))
        return
    print(report(figures))
    if options.page:
        write_page(options.page, figures)
        print(f"Written into {options.page}.", file=sys.stderr)


if __name__ == "__main__":
    main()
