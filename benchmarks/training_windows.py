"""Time how fast training windows are drawn from a tpc artefact on the disk, beside the same with all of it in memory.

    python benchmarks/training_windows.py [runs/mine/sample-tpc] [--preset small] [--workers 2] [--json]

Without an artefact the clips that the package carries are taken; they fit any cache.

Rows: windows of motion read with everything kept in memory, with the default cache, with none; whole batches (windows
turned into clouds) drawn by the training's own thread and by processes. Every row draws the same batches. Ratios to
the first row hold on a busy machine; the windows per second do not.
"""

from __future__ import annotations

import argparse
import json
import resource
import tempfile
import time
from collections.abc import Callable
from itertools import islice
from pathlib import Path

import numpy as np
import torch

import stages.shared.clips
from data_schemas.tpc import TpcReader
from stages.ingest import config as ingest_config
from stages.ingest import run as ingest
from stages.registry import stage_named
from stages.sample_tpc import config as sample_config
from stages.sample_tpc import run as sample_tpc
from stages.shared.settings.layers import Layer, settle
from stages.shared.settings.presets import preset_layers
from stages.shared.training.batches import drawn_ahead
from stages.shared.training.config import TrainingConfig
from stages.shared.training.stage import window_pools
from stages.shared.training.windows import WindowPool
from stages.train.ae.task import AutoencoderTask

_BATCHES = 40


def peak_mb() -> float:
    """Peak resident memory of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def rate(draw: Callable[[int], object], batch: int) -> float:
    """Windows per second over the batches."""
    began = time.perf_counter()
    for number in range(_BATCHES):
        draw(number)
    return _BATCHES * batch / (time.perf_counter() - began)


def reading_rates(reader: TpcReader, config: TrainingConfig) -> dict[str, float]:
    """Windows of motion a second; what is kept in memory was wanted before, as in the middle of a training."""
    found = {}
    for name, limit in (("in memory", 1e6), (f"cache of {config.cache_mb:g} MB", config.cache_mb), ("no cache", 0)):
        pool = WindowPool(reader, ("train",), cache_mb=limit)

        def draw(number: int, pool: WindowPool = pool) -> object:
            return pool.draw(config.batch, config.window, np.random.default_rng(number), augment=True)

        # In memory: the same batches before. Otherwise others, enough of them to fill the cache.
        for number in range(_BATCHES) if limit > 1e5 else range(_BATCHES, 1 + _BATCHES * (10 if limit else 1)):
            draw(number)
        found[name] = rate(draw, config.batch)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tpc", nargs="?", type=Path)
    parser.add_argument("--preset", default="small")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        measure(options, options.tpc or carried_clips(Path(scratch)))


def carried_clips(folder: Path) -> Path:
    """A tpc artefact of the clips that the package carries."""
    sources = (str(Path(stages.shared.clips.__file__).parent),)
    ingest.run(ingest_config.Config(sources=sources, output=folder / "motion", workers=1))
    sample_tpc.run(sample_config.Config(motion=folder / "motion", output=folder / "tpc"))
    return folder / "tpc"


def measure(options: argparse.Namespace, tpc: Path) -> None:
    """Time and print."""
    layers = [*preset_layers(options.preset, "train-ae"), Layer("here", {"tpc": str(tpc), "output": "none"})]
    config = settle(stage_named("train-ae").config_type(), layers, what="the benchmark")
    config = config.model_copy(update={"steps": _BATCHES + 4})
    torch.set_num_threads(1)
    with TpcReader(tpc) as reader:
        rows = {f"read, {name}": value for name, value in reading_rates(reader, config).items()}
        task = AutoencoderTask(config, *window_pools(reader, config), torch.device("cpu"))
        for workers in (0, options.workers):
            drawn = drawn_ahead(task, config.model_copy(update={"workers": workers}), [range(config.batch)], 0)
            list(islice(drawn, 4))  # until the processes have started
            name = f"drawn by {workers} processes" if workers else "drawn by a thread"
            rows[name] = rate(lambda _, drawn=drawn: next(drawn), config.batch)
            drawn.close()
    first = next(iter(rows.values()))
    if options.json:
        print(
            json.dumps(
                {"windows_per_s": rows, "ratio": {k: v / first for k, v in rows.items()}, "peak_mb": peak_mb()}
            )
        )
        return
    print(f"{config.batch} windows of {config.window} frames, {config.points} points; torch with one thread")
    for name, value in rows.items():
        print(f"{name:<28}{value:>9.0f} windows/s  {value / first:>6.2f}")
    print(f"peak memory {peak_mb():.0f} MB")


if __name__ == "__main__":
    main()
