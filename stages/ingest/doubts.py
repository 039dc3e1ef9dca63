"""What the clips' quality says of a collection as a whole, in sentences."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePosixPath

import numpy as np

from data_schemas.clips import ClipRow

FEWEST = 5  # clips of a folder that say something together
# Mean log2 of the speed of a folder's clips, less its standard error, from which its frame rate is suspected: a few
# acrobatics look fast at their own speed, too.
TOGETHER = 0.5


def doubts_of(rows: Sequence[ClipRow]) -> list[str]:
    """Folders whose clips together seem to be played at a wrong speed, and how many clips have which fault."""
    lines = [*_rates(rows)]
    faults = {
        "hold a T-pose": [row.quality.t_pose for row in rows],
        "have joints that jump by more than 115 degrees": [row.quality.flips > 0 for row in rows],
        "seem to have left and right exchanged": [row.quality.swapped for row in rows],
        "repeat more than a tenth of their frames": [(row.quality.repeated_share or 0) > 0.1 for row in rows],
        "slide on standing feet, at more than 0.25 m/s": [(row.quality.foot_skate or 0) > 0.25 for row in rows],
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
                f"if their frame rate is wrong, say it, as in --fps-override '*{PurePosixPath(place).name}*=60'."
            )
    return lines
