"""`summary.md` of `pumps measure solve`: true clouds by archive, and the error from each fault of a cloud."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from data_schemas.metrics import MetricRow
from stages.measure.solve.conditions import ONE_KEY, TRUE
from stages.measure.solve.config import Config
from stages.measure.solve.measurements import LABELS
from stages.measure.solve.methods import SLERP
from stages.shared.settings.command_line import command_line
from stages.shared.statistics.bootstrap import Estimate, mean_interval
from stages.shared.statistics.table import Entry, Row, without_repeats
from stages.shared.statistics.tables import ALL

LEGEND = (
    "Mean over frames [95% bootstrap interval over clips], on all bones that clouds see, keys included. "
    "Jerk: mean third difference of joints' places, over the truth's. Foot skate: horizontal speed of the feet "
    "while the true feet stand (docs/evaluation.md). The solve sees positions, body groups and the keys' poses; "
    "slerp the keys' poses alone."
)
FAULTS = ("mpjpe_mm", "mpjae_deg", "l2q", "jerk_ratio")


def summary_md(config: Config, rows: Sequence[MetricRow]) -> str:
    """The whole Markdown page."""
    parts = [
        "# Any cloud to any skeleton: the solve\n",
        f"{len({row.clip for row in rows})} clips ({', '.join(config.splits)} split) at 30 frames a second; clouds "
        f"of {config.points} points, sigma {config.sigma_m:g} m, in random order; seed {config.seed}.\n",
        f"Made by:\n\n```\n{command_line('pumps measure solve', config)}\n```\n",
        LEGEND + "\n",
    ]
    true = [row for row in rows if row.task == TRUE]
    worse = [row for row in rows if row.task != TRUE]
    if true:
        parts += ["## True clouds\n", *true_table(true), ""]
    if worse:
        parts += ["## Worse clouds, other sizes, stranger rigs\n", _sample_text(config), *fault_table(worse), ""]
        archives = _in_order(row.archive for row in worse)
        for archive in archives if len(archives) > 1 else []:
            parts += [f"### {archive}\n", *fault_table([row for row in worse if row.archive == archive]), ""]
    return "\n".join(parts)


def true_table(rows: Sequence[MetricRow]) -> list[str]:
    """Markdown: every archive, interval and method, with intervals."""
    metrics = [metric for metric in LABELS if any(row.metric == metric for row in rows)]
    shown: list[Row] = []
    archives = _in_order(row.archive for row in rows)
    for archive in [*archives, ALL] if len(archives) > 1 else archives:
        here = [row for row in rows if archive in (row.archive, ALL)]
        for interval in sorted({row.interval for row in here}):
            for method in _in_order(row.method for row in here):
                cells = [_text(_mean(here, interval, method, metric)) for metric in metrics]
                count = len({row.clip for row in here})
                label = f"{archive} ({count} clip{'' if count == 1 else 's'})"
                entries = (Entry(text) for text in (method, *cells))
                shown.append(Row((label, str(interval)), tuple(entries)))
    return [
        f"| data | keys every | method | {' | '.join(LABELS[metric] for metric in metrics)} |",
        f"|---|---:|---|{'---:|' * len(metrics)}",
        *(row.markdown() for row in without_repeats(shown)),
    ]


def fault_table(rows: Sequence[MetricRow]) -> list[str]:
    """Markdown: a row for each condition, methods side by side."""
    methods = [m for m in _in_order(row.method for row in rows) if m not in (SLERP, "truth")]
    metrics = [metric for metric in FAULTS if any(row.metric == metric for row in rows)]
    head = [f"{LABELS[metric]}{f', {m}' if len(methods) > 1 else ''}" for m in methods for metric in metrics]
    lines = [
        f"| cloud | keys every | {' | '.join(head)} | slerp: MPJPE (mm) | slerp: L2Q |",
        f"|---|---:|{'---:|' * (len(head) + 2)}",
    ]
    for task in _in_order(row.task for row in rows):
        here = [row for row in rows if row.task == task]
        interval = here[0].interval
        cells = [_text(_mean(here, interval, m, metric)) for m in methods for metric in metrics]
        cells += [_text(_mean(here, interval, SLERP, metric), spans=False) for metric in ("mpjpe_mm", "l2q")]
        lines.append(f"| {task} | {'first alone' if interval == ONE_KEY else interval} | {' | '.join(cells)} |")
    return lines


def terminal_lines(rows: Sequence[MetricRow]) -> list[str]:
    """The main table, all archives together; for worse clouds only methods that follow clouds."""
    lines = []
    for task, interval in _in_order((row.task, row.interval) for row in rows):
        here = [row for row in rows if row.task == task]
        methods = _in_order(row.method for row in here)
        for method in methods if task == TRUE else [m for m in methods if m not in (SLERP, "truth")]:
            figures = [(LABELS[metric], _mean(here, interval, method, metric)) for metric in LABELS]
            values = ", ".join(f"{label} {_text(value, spans=False)}" for label, value in figures if value)
            every = "the first frame alone known" if interval == ONE_KEY else f"keys every {interval}"
            lines.append(f"{task}, {every}, {method}: {values}")
    return lines


def _sample_text(config: Config) -> str:
    return (
        f"{config.condition_seconds:g} seconds from the middle of at most {config.condition_clips} clips of each "
        "archive. Clouds of other sizes are scored in the skeleton's own; of a body of "
        "other proportions, whose path is of another length too, angles tell more than places.\n"
    )


def _mean(rows: Iterable[MetricRow], interval: int, method: str, metric: str) -> Estimate | None:
    picked = [row for row in rows if (row.interval, row.method, row.metric) == (interval, method, metric)]
    if not picked:
        return None
    values, weights = np.array([[row.value, row.windows] for row in picked]).T
    return mean_interval(values, weights)


def _text(estimate: Estimate | None, *, spans: bool = True) -> str:
    if estimate is None:
        return ""
    digits = int(np.clip(2 - np.floor(np.log10(max(abs(estimate.value), 1e-9))), 0, 4))
    text = f"{estimate.value:.{digits}f}"
    if spans and estimate.low is not None and estimate.high is not None:
        text += f" [{estimate.low:.{digits}f}, {estimate.high:.{digits}f}]"
    return text


def _in_order(values: Iterable) -> list:
    return list(dict.fromkeys(values))
