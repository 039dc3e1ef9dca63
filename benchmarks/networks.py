"""Time the networks at the sizes of a preset, and say how far the step is from the machine's matrix product.

    python benchmarks/networks.py [--preset tiny] [--json]

Prints a row for the encoder forward, a training step of the autoencoder, and the matrix product of the machine;
medians of five after one warm-up. Figures of different machines or moments do not compare: take ratios in one run.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable

import torch

from stages.networks.cloud_decoder import CloudDecoder
from stages.networks.device import choose_device, computes_bfloat16, precision
from stages.networks.frame_encoder import FrameEncoder
from stages.pointcloud.assignment import paired_difference
from stages.registry import stage_named
from stages.settings.layers import Layer, settle
from stages.settings.presets import preset_layers


def median_s(work: Callable[[], object], runs: int = 5) -> float:
    work()
    times = []
    for _ in range(runs):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


def flops_of(work: Callable[[], object]) -> int:
    """Floating-point operations of the matrix and attention kernels, forward and backward."""
    from torch.utils.flop_counter import FlopCounterMode

    with FlopCounterMode(display=False) as counter:
        work()
    return counter.get_total_flops()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", default="tiny")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    layers = [*preset_layers(options.preset, "train-ae"), Layer("here", {"tpc": "none", "output": "none"})]
    config = settle(stage_named("train-ae").config_type(), layers, what="the benchmark")
    device = choose_device("cpu")
    torch.manual_seed(0)
    encoder = FrameEncoder(config.encoder)
    decoder = CloudDecoder(encoder.latent_width, config.decoder)
    points = torch.randn(config.batch, config.window, config.points, 3) * 0.3
    groups = torch.randint(0, 5, (config.batch, config.points))
    every = groups.repeat_interleave(config.window, 0)
    times = torch.arange(float(config.window)).unsqueeze(0)

    def encode() -> None:
        with torch.no_grad(), precision(device, config.mixed_precision):
            encoder(points.flatten(0, 1), every)

    def step() -> None:
        with precision(device, config.mixed_precision):
            latents, centroids = (
                part.unflatten(0, (config.batch, -1)) for part in encoder(points.flatten(0, 1), every)
            )
            noise = decoder.draw_noise(config.batch, config.points)
            made = decoder(latents, centroids, times, groups, noise)
        paired_difference(made, points, groups).square().mean().backward()

    width = torch.bfloat16 if config.mixed_precision and computes_bfloat16(device) else torch.float32
    one = torch.randn(1024, 1024, dtype=width)
    matrix_s = median_s(lambda: one @ one)
    step_s, flops = median_s(step), flops_of(step)
    figures = {
        "preset": options.preset,
        "threads": torch.get_num_threads(),
        "frames_in_step": config.batch * config.window,
        "points": config.points,
        "encoder_frames_per_s": round(config.batch * config.window / median_s(encode)),
        "ae_step_s": round(step_s, 4),
        "ae_step_gflop": round(flops / 1e9, 2),
        "ae_step_gflop_per_s": round(flops / step_s / 1e9, 1),
        "matrix_gflop_per_s": round(2 * 1024**3 / matrix_s / 1e9, 1),
        "matrix_type": str(width).removeprefix("torch."),
    }
    if options.json:
        print(json.dumps(figures))
        return
    for name, value in figures.items():
        print(f"{name:22} {value}")


if __name__ == "__main__":
    main()
