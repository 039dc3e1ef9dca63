"""Measure how far the plain interpolation should leave slerp for the C1 cubic, by the gap's length.

    python benchmarks/damping.py runs/small/sample-tpc

Windows of the validation clips, an equal share of each archive. A row is a pair of lengths of the gap that keeps half
of the cubic, of rotations and of places; its figures are the error of the bones' heads (root of the sum of squares,
mean over frames) over that of slerp, with keys every 5, 15 and 30 frames and in transitions of 15, 30 and 60.
"""

from __future__ import annotations

import sys

import numpy as np
import torch
from torch import Tensor

from data_schemas.tpc import TpcReader
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.plain_interpolation import DAMPING, Damping
from stages.shared.kinematics.window_interpolation import interpolate_windows
from stages.shared.training.windows import WindowPool, Windows

WINDOWS, EDGE = 240, 15
EVERY, MISSING = (5, 15, 30), (15, 30, 60)
SLERP, CUBIC = Damping(1e-6, 1e-6), Damping(1e6, 1e6)
TRIED = [Damping(turns, places) for turns in (1.0, 1.3, 1.7) for places in (1.3, 2.0, 5.0, 1e6)]


def main(path: str) -> None:
    with TpcReader(path) as reader:
        pool = WindowPool(reader, ("val",))
        tasks = [
            *(masked(pool, 121, lambda frames, every=every: frames % every == 0) for every in EVERY),
            *(masked(pool, 2 * EDGE + gap, lambda frames, gap=gap: _outside(frames, gap)) for gap in MISSING),
        ]
    heads = [*(f"every {every}" for every in EVERY), *(f"transition {gap}" for gap in MISSING)]
    print(f"| turns s | places s | {' | '.join(heads)} |\n|---|---|{'---:|' * len(heads)}")
    slerp = [error(*task, SLERP) for task in tasks]
    for damping in [CUBIC, *TRIED]:
        cells = [f"{error(*task, damping) / plain:.3f}" for task, plain in zip(tasks, slerp, strict=True)]
        shown = ["inf" if value == CUBIC[0] else f"{value:g}" for value in damping]
        print(f"| {' | '.join([*shown, *cells])} |{' used' if damping == DAMPING else ''}", flush=True)


def _outside(frames: Tensor, gap: int) -> Tensor:
    return (frames < EDGE) | (frames >= EDGE + gap)


def masked(pool: WindowPool, length: int, keys) -> tuple[Windows, Tensor, Tensor]:
    """Windows, the rows of them that are whole, and their known frames."""
    windows = pool.draw(WINDOWS, length, np.random.default_rng(1), augment=False)
    frames = torch.arange(length)
    known = (keys(frames) | (frames == length - 1)).expand(WINDOWS, length) & windows.valid
    known[:, 0] = True
    return windows, windows.valid.all(1), known


def error(windows: Windows, whole: Tensor, known: Tensor, damping: Damping) -> float:
    """Mean over whole windows and their frames, metres."""
    heads, _ = interpolate_windows(
        windows.heads, windows.rotations, windows.parents, known, rate_hz=MODEL_FPS, damping=damping
    )
    seen = (windows.weights > 0).unsqueeze(1)
    return float(((heads - windows.heads).square().sum(-1) * seen).sum(-1).sqrt()[whole].mean())


if __name__ == "__main__":
    main(sys.argv[1])
