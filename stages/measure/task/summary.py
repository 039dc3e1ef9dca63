"""The page of a measurement: the task's measures by category, and error against minutes of training."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from data_schemas.metrics import MetricRow
from stages.measure.task.config import Config
from stages.shared.inference.pose_model import PoseModel
from stages.shared.markup import Markup
from stages.shared.settings.command_line import command_line
from stages.shared.statistics.category_tables import table_of
from stages.shared.statistics.line_chart import line_chart

BASE = "base"
_TITLES = {
    "mpjpe_mm": "MPJPE, mm",
    "mpjve_mm": "MPJVE, mm a frame",
    "acceleration_mm": "Acceleration error, mm a frame^2",
    "mpjae_deg": "Angles, degrees",
    "root_mm": "Error of the root's path, mm",
}
_DECIMALS = 2


@dataclass(frozen=True)
class Measured:
    """Rows of all methods, the task that they did, the networks by the names of their rows, and the NAME that
    --weights gives each row."""

    rows: Sequence[MetricRow]
    task: str
    corruption: str
    models: Mapping[str, PoseModel]
    names: Mapping[str, str]

    @property
    def metrics(self) -> list[str]:
        """The task's measures, the most important one first."""
        return list(dict.fromkeys(row.metric for row in self.rows))


def summary_md(config: Config, page: Measured) -> str:
    """The whole page."""
    windows = sum(row.windows for row in page.rows if row.method == BASE and row.metric == page.metrics[0])
    clips = len({row.clip for row in page.rows})
    parts = [
        f"# The task {page.task}\n",
        f"Made by:\n\n```\n{command_line('pumps measure task', config)}\n```\n",
        f"{clips} clips, {windows} windows of {config.window} frames at 30 fps; corruption: {page.corruption}. All "
        "networks see the same input. Means over windows; of all clips with a 95% bootstrap interval over clips. "
        f"`{BASE}`: the pose to which the networks' outputs are added.\n",
        "\n".join(
            f"- {name}: {sum(value.numel() for value in model.network.parameters()) / 1e6:.2f} M parameters, "
            f"{model.minutes:g} minutes ({model.steps} steps) of training on {model.trained_on}."
            for name, model in page.models.items()
        ),
    ]
    for metric in page.metrics:
        title = _TITLES.get(metric, metric)
        parts += [f"\n## {title}\n", *table_of(page.rows, metric, config.seed, _DECIMALS).markdown()]
    return "\n".join(parts) + "\n"


def terminal_lines(page: Measured, seed: int) -> list[str]:
    """One line a method: its first two measures over all clips."""
    shown = page.metrics[:2]
    tables = [table_of(page.rows, metric, seed, _DECIMALS) for metric in shown]
    return [
        f"{rows[0].labels[0]:24} "
        + "; ".join(
            f"{_TITLES.get(metric, metric)} {row.entries[-1].text}" for metric, row in zip(shown, rows, strict=True)
        )
        for rows in zip(*(table.rows for table in tables), strict=True)
    ]


def curve_of(page: Measured) -> Markup | str:
    """The first measure against minutes of training, a line for each name with several trainings; "" without any."""
    lines: dict[str, list[tuple[float, float]]] = {}
    for row, model in page.models.items():
        if model.minutes > 0:  # which a logarithmic axis needs
            lines.setdefault(page.names[row], []).append((model.minutes, _mean_of(page, row)))
    lines = {name: sorted(points) for name, points in lines.items() if len(points) > 1}
    if not lines:
        return ""
    minutes = sorted({x for points in lines.values() for x, _ in points})
    level = _mean_of(page, BASE)
    lines[BASE] = [(minutes[0], level), (minutes[-1], level)]
    title = f"{_TITLES.get(page.metrics[0], page.metrics[0])}, against minutes of training: the task {page.task}"
    return line_chart(title, lines, {x: f"{x:g}" for x in minutes}, shown=math.log, dots=True)


def _mean_of(page: Measured, method: str) -> float:
    """A method's first measure, mean over all windows."""
    own = [row for row in page.rows if row.method == method and row.metric == page.metrics[0]]
    return float(np.average([row.value for row in own], weights=[row.windows for row in own]))
