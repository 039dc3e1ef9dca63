"""Warnings about a collection as a whole, from its clips' quality, one sentence each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePosixPath

import numpy as np

from data_schemas.clips import ClipRow

FEWEST = 5  # fewest clips of a folder that are judged together
TOGETHER = 0.5


def doubts_of(rows: Sequence[ClipRow]) -> list[str]:
    """Folders whose clips as a whole seem to be played at a wrong speed, and the number of clips with each fault."""
    lines = [*_rates(rows)]
    faults = {
        "hold a T-pose": [row.quality.t_pose for row in rows],
        "have joints that jump by more than 115 degrees": [row.quality.flips > 0 for row in rows],
        "seem to have left and right swapped": [row.quality.swapped for row in rows],
        "repeat more than a tenth of their frames": [(row.quality.repeated_share or 0) > 0.1 for row in rows],
        "have feet that slide at more than 0.25 m/s while standing": [
            (row.quality.foot_skate or 0) > 0.25 for row in rows
        ],
    }
    found = [f"{sum(flags)} {fault}" for fault, flags in faults.items() if any(flags)]
    if found:
        lines.append(f"Of {len(rows)} clips, {'; '.join(found)}. --where leaves such clips out (docs/formats.md).")
    return lines


def _rates(rows: Sequence[ClipRow]) -> list[str]:
    folders: dict[str, list[float]] = {}
    for row in rows:
        if row.quality.speed_log2 is not None:
            place = str(PurePosixPath(row.source.replace("\\", "/").replace("!", "/")).parent)
            folders.setdefault(place, []).append(row.quality.speed_log2)
    lines = []
    for place, speeds in folders.items():
        mean = float(np.mean(speeds))
        error = float(np.std(speeds)) / len(speeds) ** 0.5
        if len(speeds) >= FEWEST and abs(mean) - error > TOGETHER:
            way = "fast" if mean > 0 else "slow"
            lines.append(
                f"The {len(speeds)} clips in {place} seem to be played too {way} ({2**mean:.2f} times their speed): "
                "if their frame rate is wrong, correct it, for example with "
                f"--fps-override '*{PurePosixPath(place).name}*=60'."
            )
    return lines
