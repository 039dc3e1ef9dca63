"""The page of a measurement: how far latents move under every change, and how well they are decoded then."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from data_schemas.metrics import MetricRow
from stages.measure.latents.changes import Change
from stages.measure.latents.config import Config
from stages.shared.settings.command_line import command_line
from stages.shared.statistics.bootstrap import Estimate, mean_interval

BASE_WORDS = "nothing"
_COLUMNS = (
    ("move_window", "move / within a window", 2, True),
    ("move_any", "move / any two frames", 2, True),
    ("cosine", "cosine", 2, False),
    ("frames_off", "frames off", 1, True),
    ("found", "within a frame", 2, False),
    ("same_window", "in its window", 2, False),
    ("own_mm", "decoded, own cloud, mm", 1, True),
    ("own_moving_mm", "its variation, mm", 1, False),
    ("cross_mm", "decoded, base cloud, mm", 1, True),
    ("cross_moving_mm", "its variation, mm", 1, False),
)
_LEGEND = (
    "Means over clips, with a 95% bootstrap interval over clips where one is given. **Move**: root-mean-square "
    "distance of a frame's latent from the same frame's before the change, as a share of the distance of two frames "
    "drawn at random from one window (whichever), or from anywhere. **Cosine**: of the two latents, less the mean of "
    "all. "
    "**Frames off**: how far in time the nearest of the window's own latents is; **within a frame**: share of "
    "frames where it is at most one off; **in its window**: share whose nearest latent of all windows is in the "
    "right one. **Decoded**: mean distance of matched pairs between the cloud decoded from the changed latents and "
    "the cloud that was encoded (own), or the cloud before the change where the motion is the same (base); "
    "**its variation**: what of that changes over time. "
    "**Spread**: points spread evenly over the bones, as filling spreads them, compared with such points before the "
    "change; all other rows are drawn at random."
)


@dataclass(frozen=True)
class LatentResults:
    """All measurements."""

    config: Config
    changes: Sequence[Change]
    rows: Sequence[MetricRow]
    points: int
    windows: int

    def mean(self, change: str, metric: str, archive: str = "") -> Estimate | None:
        """Mean over clips, weighted by their windows; None if it was not measured."""
        found = [
            (row.value, float(row.windows))
            for row in self.rows
            if row.method == change and row.metric == metric and archive in ("", row.archive)
        ]
        if not found:
            return None
        values, weights = np.array(found).T
        return mean_interval(values, weights, self.config.seed)


def summary_md(measured: LatentResults) -> str:
    """The whole page."""
    config = measured.config
    archives = list(dict.fromkeys(row.archive for row in measured.rows))
    clips = len({(row.archive, row.clip) for row in measured.rows})
    level = _text(measured.mean("unchanged", "level_mm"), 1, True)
    moving = _text(measured.mean("unchanged", "level_moving_mm"), 1, False)
    parts = [
        "# How far latents move\n",
        f"Weights `{config.weights}`; {measured.windows} windows of {config.window} frames at 30 a second from "
        f"{clips} clips ({', '.join(config.splits)} split) of {', '.join(archives)}; {measured.points} points, sigma "
        f"{config.sigma_m} m, seed {config.seed}.\n",
        *_table(measured),
        "",
        _LEGEND + "\n",
        f"Two true draws of the clouds, unchanged, are {level} mm apart and vary over time by {moving} mm: a level "
        "that is no error.\n",
    ]
    if len(archives) > 1:
        parts += ["## By data set: move, as a share of the distance of any two frames\n", *_by_archive(measured), ""]
    parts.append(f"Made by:\n\n```\n{command_line('pumps measure latents', config)}\n```\n")
    return "\n".join(parts)


def terminal_lines(measured: LatentResults) -> list[str]:
    """The changes and the most important columns, aligned."""
    shown = ("move_any", "frames_off", "own_mm", "cross_mm")
    columns = [column for column in _COLUMNS if column[0] in shown]
    width = max(len(change.name) for change in measured.changes)
    lines = [f"{'':<{width}}  " + "  ".join(f"{title:>24}" for _, title, _, _ in columns)]
    for change in measured.changes:
        cells = (_text(measured.mean(change.name, metric), digits, True) for metric, _, digits, _ in columns)
        lines.append(f"{change.name:<{width}}  " + "  ".join(f"{cell:>24}" for cell in cells))
    return lines


def _table(measured: LatentResults) -> Iterator[str]:
    yield f"| what is changed | {' | '.join(title for _, title, _, _ in _COLUMNS)} |"
    yield f"|---|{'---:|' * len(_COLUMNS)}"
    yield f"| {BASE_WORDS} | {' | '.join(_cells(measured, 'unchanged'))} |"
    kind = ""
    for change in measured.changes:
        if change.kind != kind:
            kind = change.kind
            yield f"| *{kind}* |{' |' * len(_COLUMNS)}"
        yield f"| {change.name} | {' | '.join(_cells(measured, change.name))} |"


def _cells(measured: LatentResults, change: str) -> Iterator[str]:
    for metric, _, digits, interval in _COLUMNS:
        yield _text(measured.mean(change, metric), digits, interval)


def _by_archive(measured: LatentResults) -> Iterator[str]:
    archives = list(dict.fromkeys(row.archive for row in measured.rows))
    yield f"| what is changed | {' | '.join(archives)} |"
    yield f"|---|{'---:|' * len(archives)}"
    for change in measured.changes:
        cells = (_text(measured.mean(change.name, "move_any", archive), 2, True) for archive in archives)
        yield f"| {change.name} | {' | '.join(cells)} |"


def _text(estimate: Estimate | None, digits: int, interval: bool) -> str:
    if estimate is None:
        return ""
    text = f"{estimate.value:.{digits}f}"
    if not interval or estimate.low is None or estimate.high is None:
        return text
    return f"{text} [{estimate.low:.{digits}f}, {estimate.high:.{digits}f}]"
