"""Windows a second of `pumps train lms`, and where its time goes: drawing, encoding, the step, the optimiser.

    OMP_NUM_THREADS=1 python benchmarks/synthesiser_training.py [--preset laptop] [--tpc FOLDER] [--page PAGE]

The training's own code draws windows of real motion (the clips that come with pumps, or a tpc artefact), encodes them
with an autoencoder of the preset's sizes and takes steps. With `reuse` an encoded window is used in that many steps,
so the rate is that of a long training. Each part stands beside its limit: the time that its products, or what it
reads and writes, would take at the rates of this machine, measured in the same rounds. Seconds are CPU seconds.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from measuring.counting import work_of
from measuring.machine import limits, name_of
from measuring.page import limit_cells, limit_of
from measuring.section import replace_section
from torch import nn

import stages.shared.clips
from data_schemas.tpc import TpcReader
from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest
from stages.registry import stage_named
from stages.sample_tpc.config import Config as SampleConfig
from stages.sample_tpc.run import run as sample_tpc
from stages.shared.inference.models import Autoencoder
from stages.shared.networks.layers.device import computes_bfloat16
from stages.shared.settings.layers import Layer, settle
from stages.shared.settings.presets import preset_layers
from stages.shared.synthesiser_training import task as training
from stages.shared.training.optimiser import Optimiser
from stages.shared.training.task import step_random
from stages.shared.training.windows import WindowPool
from stages.train.ae.task import AutoencoderNetworks
from stages.train.lms.config import Config

CPU = torch.device("cpu")
PARTS = ("drawing", "encoding", "step", "optimiser")
DRAWN = ("drawing", "encoding")  # done once for `reuse` steps


def tpc_of_embedded_clips(folder: Path) -> Path:
    """The clips that come with pumps as a tpc artefact below `folder`."""
    clips = Path(stages.shared.clips.__path__[0])
    ingest(IngestConfig.model_validate({"sources": (str(clips),), "output": folder / "motion"}))
    sample_tpc(SampleConfig.model_validate({"motion": folder / "motion", "output": folder / "tpc"}))
    return folder / "tpc"


def settings_of(preset: str, stage: str, **given: Any) -> Any:
    """The preset's settings of a training."""
    layers = [*preset_layers(preset, stage), Layer("here", {"output": "none", "tpc": "none"} | given)]
    return settle(stage_named(stage).config_type(), layers, what="the benchmark")


def parts_of(config: Config, ae: Any, reader: TpcReader) -> dict[str, Callable[[], object]]:
    """The parts of a training's step on fresh windows, to be called in this order."""
    torch.manual_seed(0)
    fresh = AutoencoderNetworks(ae)
    autoencoder = Autoencoder(fresh.encoder, fresh.decoder, ae.window, ae.points, (), "", CPU)
    pool = WindowPool(reader, ("train", "val", "test"), cache_mb=config.cache_mb)
    task = training.SynthesiserTask(config, autoencoder, pool, pool, CPU)
    optimiser = Optimiser(task.networks, config)
    parameters, drawer, rows = list(task.networks.parameters()), task.drawer(), tuple(range(config.batch))
    task.networks.train()
    here: dict[str, Any] = {"step": 0}

    def draw() -> None:
        here["step"] += 1
        here["batch"] = drawer.draw(step_random(config.seed, 1, here["step"], rows))

    def encode() -> None:
        here["encoded"] = task.frozen.encode(here["batch"])

    def step() -> None:
        optimiser.zero_grad()
        task.loss_of(here["encoded"])[0].backward()
        nn.utils.clip_grad_norm_(parameters, config.clip_norm)

    def update() -> None:
        optimiser.step(config.learning_rate)

    return dict(zip(PARTS, (draw, encode, step, update), strict=True))


def measure(options: argparse.Namespace) -> str:
    """The table, in Markdown."""
    with tempfile.TemporaryDirectory() as folder:
        tpc = options.tpc or tpc_of_embedded_clips(Path(folder))
        ae = settings_of(options.preset, "train-ae")
        long = settings_of(options.preset, "train-lms", ae="none", device="cpu")
        config = long.model_copy(update={"reuse": 1, "output": Path(folder) / "out"})
        with TpcReader(tpc) as reader:
            parts = parts_of(config, ae, reader)
            for part in parts.values():
                part()
            meters = limits(CPU)
            rates = {name: 0.0 for name in meters}
            seconds = {name: float("inf") for name in parts}
            for _ in range(options.rounds):
                rates = {name: max(rates[name], meter()) for name, meter in meters.items()}
                for name, part in parts.items():
                    began = time.process_time()
                    part()
                    seconds[name] = min(seconds[name], time.process_time() - began)
            work = {name: work_of(part, CPU) for name, part in parts.items()}
    bfloat16 = computes_bfloat16(CPU)
    whole = sum(spent / (long.reuse if name in DRAWN else 1) for name, spent in seconds.items())
    lines = [
        f"`{options.preset}`: steps of {config.batch} windows of {config.window} frames of {config.points} points, "
        f"each encoded window in {long.reuse} steps: **{config.batch / whole:.1f} windows/s of a core** "
        f"({config.batch / sum(seconds.values()):.1f} while every window is new). {name_of(CPU)}, "
        f"{torch.get_num_threads()} threads, PyTorch {torch.__version__}; the least of {options.rounds} rounds.",
        "",
        "| part | CPU s | share | GFLOP | GB moved | limit | at the limit, s | reached |",
        "|---|---:|---:|---:|---:|---|---:|---:|",
    ]
    for name, spent in seconds.items():
        share = spent / (long.reuse if name in DRAWN else 1) / whole
        limit = limit_of(work[name].gflop, work[name].gb, rates, bfloat16=bfloat16)
        cells = [name, f"{spent:.3f}", f"{100 * share:.0f} %", f"{work[name].gflop:.1f}", f"{work[name].gb:.1f}"]
        lines.append(f"| {' | '.join([*cells, *limit_cells(limit, spent)])} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", default="laptop")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--tpc", type=Path, help="draw from this tpc artefact")
    parser.add_argument("--page", type=Path, help="a page to write the table into, between its markers")
    options = parser.parse_args()
    table = measure(options)
    print(table)
    if options.page:
        replace_section(options.page, "synthesiser training", table)


if __name__ == "__main__":
    main()
