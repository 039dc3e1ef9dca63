"""The tables of limbs that are lost: what completes them, for a while and for good."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from data_schemas.metrics import MetricRow
from stages.measure.body_parts.config import Config
from stages.measure.body_parts.lost import FOR_GOOD, LOST_METRICS, SEEN_AGAIN
from stages.shared.statistics.bootstrap import mean_interval
from stages.shared.statistics.table import Entry, Row, Table

_HEADS = ("MPJPE, cm at 1.80 m", "MPJAE, degrees", "step at a seam, cm")


def lost_tables(config: Config, rows: Sequence[MetricRow], sets: Sequence[str]) -> Iterator[str]:
    """Lines of Markdown; none where no limb was lost."""
    if not any(row.metric in LOST_METRICS for row in rows):
        return
    limbs = ", ".join(name.replace("_", " ") for name in config.lost)
    yield "\n## Lost limbs\n"
    yield (
        f"After one window of the whole body, these limbs are lost for some windows: {limbs}. The other joints and "
        f"the pelvis' path stay known. `infill` uses the weights {config.pumps} and starts from the plain "
        "interpolation. Bodies of parts are measured in three ways: with the limbs hidden, the lost joints have the "
        "training's mean pose before the body is encoded; with the last latent again, the window before the loss is "
        "repeated; with the limbs seen, nothing is lost. The errors are those of the lost limbs' joints in the lost "
        "frames: means over stretches, with a 95% bootstrap interval over clips. The step at a seam is how far these "
        "joints move from one frame to the next, where lost frames begin or end.\n"
    )
    for label in sets:
        for task in (SEEN_AGAIN, FOR_GOOD):
            own = [row for row in rows if row.archive == label and row.task == task]
            if not own:
                continue
            clips = {row.clip: row.windows for row in own}
            yield f"\n### {label}: {task}\n"
            yield f"{sum(clips.values())} stretches of {len(clips)} clips, {own[0].interval} lost frames each:\n"
            yield from _table(own, config.seed).markdown()


def _table(rows: Sequence[MetricRow], seed: int) -> Table:
    lines = []
    for method in dict.fromkeys(row.method for row in rows):
        entries = []
        for metric in LOST_METRICS:
            some = [row for row in rows if row.method == method and row.metric == metric]
            values, windows = (np.array([getattr(row, name) for row in some], float) for name in ("value", "windows"))
            estimate = mean_interval(values, windows, seed)
            span = f"[{estimate.low:.2f}, {estimate.high:.2f}]" if estimate.low is not None else ""
            entries.append(Entry(f"{estimate.value:.2f}", span))
        lines.append(Row((method,), tuple(entries)))
    return Table(("completed by",), _HEADS, tuple(lines))
