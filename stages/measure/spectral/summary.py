"""The tables of predicted meshes, as SpecTrHuMS prints them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from stages.shared.meshes.spectral_basis import Compaction
from stages.shared.statistics.table import Entry, Row, Table

# The paper's times in milliseconds.
TIMES_MS = (80, 160, 320, 400, 560, 720, 880, 1000)


@dataclass
class MethodValues:
    """Values of one method over W windows, at F times; empty where it knows no joints or no surface.

    mpjpe, until: (W, F) millimetres at each time, and averaged up to it. melv: (W, F) millimetres. rmse: (W, F), a
    share of the bounding box. seconds: how long it predicted, in all.
    """

    mpjpe: list[np.ndarray] = field(default_factory=list)
    until: list[np.ndarray] = field(default_factory=list)
    melv: list[np.ndarray] = field(default_factory=list)
    rmse: list[np.ndarray] = field(default_factory=list)
    seconds: float = 0.0


def times_of(ahead: int, fps: float) -> tuple[list[int], np.ndarray]:
    """The paper's times that are within `ahead` frames, in milliseconds, and the frames at them, 0 for the first."""
    frames = {ms: round(ms * fps / 1000) - 1 for ms in TIMES_MS}
    kept = [ms for ms, frame in frames.items() if 0 <= frame < ahead]
    return kept, np.array([frames[ms] for ms in kept], int)


def summary_md(
    values: Mapping[str, MethodValues],
    times: Sequence[int],
    windows: int,
    ahead: int,
    fps: float,
    held: Mapping[str, Sequence[Compaction]],
) -> str:
    """Markdown of all tables; `held` is what the lowest coefficients hold of true meshes, by the weights' names."""
    lines = [f"{windows} windows of held-out clips.", ""]
    for title, name, digits, deviation in (
        ("MPJPE at each time, mm (Table 1)", "mpjpe", 1, False),
        ("MPJPE averaged up to each time, mm (Table 2)", "until", 1, False),
        ("MELV, mm, with its deviation over windows (Table 3)", "melv", 2, True),
        ("RMSE of vertices as a share of the bounding box (Table 4)", "rmse", 4, False),
    ):
        rows = [
            Row(
                (method,),
                tuple(_entry(np.stack(getattr(each, name))[:, at], digits, deviation) for at in range(len(times))),
            )
            for method, each in values.items()
            if getattr(each, name)
        ]
        if rows:
            table = Table(("method",), tuple(f"{ms} ms" for ms in times), tuple(rows))
            lines += [f"## {title}", "", *table.markdown(), ""]
    for name, found in held.items():
        rows = [
            Row(
                (str(each.size),),
                (Entry(f"{each.energy:.5f}"), Entry(f"{each.rmse_mm:.2f}"), Entry(f"{each.worst_mm:.1f}")),
            )
            for each in found
        ]
        if rows:
            table = Table(("coefficients",), ("energy", "error, mm RMS", "worst vertex, mm"), tuple(rows))
            lines += [
                f"## True meshes from the lowest coefficients of the basis of {name}",
                "",
                *table.markdown(),
                "",
            ]
    fast = [
        f"- {method}: {windows * ahead / fps / each.seconds:.1f} times real time."
        for method, each in values.items()
        if each.seconds > 0
    ]
    return "\n".join([*lines, "## Speed, without the transform to vertices", "", *fast, ""])


def _entry(values: np.ndarray, digits: int, deviation: bool) -> Entry:
    span = f"± {values.std():.{digits}f}" if deviation else ""
    return Entry(f"{values.mean():.{digits}f}", span)
