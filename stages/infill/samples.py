"""What `pumps infill --samples` says of several fills: how far they are from each other, and how each moves."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from data_schemas.skeleton import Skeleton
from stages.shared.contract import StageReport
from stages.shared.inference.filled import Filled
from stages.shared.kinematics.forward_numpy import positions_of


def with_samples(
    report: StageReport, outputs: Sequence[Path], skeleton: Skeleton, fills: Sequence[Filled], missing: np.ndarray
) -> StageReport:
    """The report of the first fill, with a line and figures for each of several; `missing` (M,) are the frames that
    were filled."""
    apart = distances_mm(skeleton, fills, missing)
    rows = [
        {
            "file": str(output),
            "from_others_mm": float(np.delete(apart[number], number).mean()),
            "foot_skate_mps": None if np.isnan(fill.skate_mps) else fill.skate_mps,
            "velocity_jump_mps": float(fill.jumps_mps.mean()) if len(fill.jumps_mps) else None,
        }
        for number, (output, fill) in enumerate(zip(outputs, fills, strict=True))
    ]
    mean = float(apart.sum() / (len(fills) * (len(fills) - 1)))
    lines = [
        f"{len(fills)} fills, on average {mean:.0f} mm from each other (mean over frames and joints). "
        "The figures above are those of the first, the usual one. File, mm from the others, foot skate in m/s:"
    ]
    for row in rows:
        skate = "no foot stands" if row["foot_skate_mps"] is None else f"{row['foot_skate_mps']:.3f}"
        lines.append(f"  {row['file']}  {row['from_others_mm']:.0f}  {skate}")
    figures = {**report.figures, "samples": rows, "samples_apart_mm": mean}
    return report.model_copy(update={"output": outputs[0], "lines": [*report.lines, *lines], "figures": figures})


def distances_mm(skeleton: Skeleton, fills: Sequence[Filled], frames: np.ndarray) -> np.ndarray:
    """(N, N) mean distance between the body's joints of N fills, over some frames, millimetres."""
    body = skeleton.groups >= 0
    places = [positions_of(skeleton, fill.motion)[frames][:, body] for fill in fills]
    apart = np.zeros((len(places), len(places)))
    for a, b in combinations(range(len(places)), 2):
        apart[a, b] = apart[b, a] = 1000 * np.linalg.norm(places[a] - places[b], axis=-1).mean()
    return apart
