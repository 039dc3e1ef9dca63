"""Measure how a pose should go on beyond its last key: held, or gliding on with a speed that decays.

    python benchmarks/beyond_keys.py runs/reproduce/sample-tpc

Windows of the validation clips of each archive (of training clips too, where those are few), all frames known up to
the sixtieth. A row is a pair of time constants, for places and for rotations; its figures are the error of the bones'
heads in the next half second and second (root of the sum of squares, mean over frames) over that of the held pose.
"""

from __future__ import annotations

import math
import sys

import numpy as np
import torch

from data_schemas.tpc import TpcReader
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.plain_interpolation import Glide
from stages.shared.kinematics.window_interpolation import interpolate_windows
from stages.shared.training.windows import WindowPool

KNOWN, FRAMES, ENOUGH = 60, 90, 60
SAME = [(s, s) for s in (0.1, 0.2, 0.3, 0.5)]
PAIRS = [(root, turn) for root in (0.4, 0.6, 0.8, 1.2) for turn in (0.05, 0.1, 0.2)]
FOREVER = (1e4, 1e4)  # constant speed


def main(path: str) -> None:
    with TpcReader(path) as reader:
        pools = {split: WindowPool(reader, (split,), least_frames=FRAMES) for split in ("val", "train")}
        archives = sorted({reader.row(clip).source.split("!")[0] for clip in pools["val"].clips})
        windows = {archive: windows_of(reader, pools, archive) for archive in archives}
    names = [archive.rsplit("/", 1)[-1] for archive in archives]
    print(f"| root s | turn s | {' | '.join(names)} |\n|---|---|{'---|' * len(names)}")
    held = {archive: errors(each, None) for archive, each in windows.items()}
    for root, turn in [*SAME, *PAIRS, FOREVER]:
        cells = []
        for archive, each in windows.items():
            found = errors(each, Glide(root, turn).in_frames(MODEL_FPS))
            cells.append(" / ".join(f"{one / other:.2f}" for one, other in zip(found, held[archive], strict=True)))
        shown = ["inf" if value == FOREVER[0] else f"{value:g}" for value in (root, turn)]
        print(f"| {shown[0]} | {shown[1]} | {' | '.join(cells)} |")


def windows_of(reader: TpcReader, pools: dict[str, WindowPool], archive: str) -> list:
    """Windows of an archive, six a clip at most."""
    rng, found = np.random.default_rng(0), []
    for pool in pools.values():
        clips = [i for i, clip in enumerate(pool.clips) if reader.row(clip).source.split("!")[0] == archive]
        each = np.repeat(np.array(clips[:ENOUGH], dtype=int), 2 if len(clips) > ENOUGH else 6)
        if len(each) and len(found) < ENOUGH:
            first = np.floor(rng.uniform(0, 1, len(each)) * (pool.lengths[each] - FRAMES + 1))
            found += [pool.at(each[i : i + 1], first[i : i + 1], FRAMES) for i in range(len(each))]
    return found


def errors(windows: list, glide: Glide | None) -> tuple[float, float]:
    """In the half second and in the second after the last key."""
    known = torch.zeros(1, FRAMES, dtype=torch.bool)
    known[:, :KNOWN] = True
    apart = []
    for each in windows:
        heads, _ = interpolate_windows(
            each.heads, each.rotations, each.parents, known, rate_hz=MODEL_FPS, glide=glide
        )
        seen = each.weights[0] > 0
        apart.append((heads - each.heads)[:, KNOWN:, seen].square().sum((2, 3)).sqrt()[0])
    mean = torch.stack(apart).mean(0)
    return float(mean[: math.ceil(MODEL_FPS / 2)].mean()), float(mean.mean())


if __name__ == "__main__":
    main(sys.argv[1])
