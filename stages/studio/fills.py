"""What one run of `pumps infill` made: a motion of the session for each of its fills."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stages.shared.contract import StageReport


@dataclass(frozen=True)
class Fill:
    """One fill.

    motion: the id that it gets. file: what infill wrote. sample: its number, from 1, the usual one.
    told, gist: what the stage said of it, a line each, and the few of these that the page shows at once.
    """

    motion: str
    file: Path
    sample: int
    told: tuple[str, ...]
    gist: tuple[str, ...]

    @property
    def options(self) -> dict[str, Any]:
        """What `pumps infill` needs to make it alone."""
        return {"sample": self.sample} if self.sample > 1 else {}


def fills_of(report: StageReport, output: Path, motions: Sequence[str]) -> list[Fill]:
    """The fills of a run, in the order of their numbers.

    Args:
        output: as the run was given it. motions: ids for the fills, as many as were asked for.
    """
    rows: list[dict[str, Any]] = report.figures.get("samples", [])
    if not rows:
        return [Fill(motions[0], output, 1, tuple(report.lines), tuple(report.gist))]
    found = []
    for number, (motion, row) in enumerate(zip(motions, rows, strict=True), 1):
        told = (*report.gist, _line(row, number, len(rows)))
        found.append(Fill(motion, Path(row["file"]), number, told, told))
    return found


def _line(row: dict[str, Any], number: int, count: int) -> str:
    skate = row["foot_skate_mps"]
    feet = "" if skate is None else f", and standing feet move at {skate:.3f} m/s"
    return (
        f"Of {count} fills, sample {number} is {row['from_others_mm']:.0f} mm from the others "
        f"(mean over frames and joints){feet}."
    )
