"""The page of a measurement: errors under each constraint, by category of clips."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from data_schemas.metrics import MetricRow
from stages.measure.constraints.config import Config
from stages.shared.inference.models import Models
from stages.shared.settings.command_line import command_line
from stages.shared.statistics.category_tables import table_of

PLAIN, FREE, CONSTRAINED = "plain interpolation, constrained", "filled between keys alone", "filled, constrained"
METRICS = ("mpjpe_mm", "mpjae_deg")
_TITLES = {
    "arms": "Arms alone to fill; errors of the arms",
    "legs": "Legs alone to fill; errors of the legs",
    "hands": "Both hands pinned to their true places; errors of the arms",
    "path": "The pelvis on its true path over the ground; errors of all joints",
}
_UNITS = {"mpjpe_mm": "MPJPE, mm", "mpjae_deg": "Angles, degrees"}


def summary_md(config: Config, rows: Sequence[MetricRow], models: Models, figures: Mapping[str, int]) -> str:
    """The whole page."""
    parts = [
        "# Filling under constraints\n",
        f"Made by:\n\n```\n{command_line('pumps measure constraints', config)}\n```\n",
        f"{figures['clips']} clips, {figures['windows']} windows of {config.window} frames at 30 a second, a key "
        f"every {config.interval} frames; weights {models.name}. Errors are global errors of the missing frames, as "
        "means over windows. Those of all clips have a 95% bootstrap interval over clips. All rows of a table have "
        f"the same whole keys. {figures['out_of_reach']} windows are left out of the table of hands, since the "
        "filled body could not reach the places.\n",
    ]
    for constraint in config.constraints:
        own = [row for row in rows if row.task == constraint]
        parts.append(f"\n## {_TITLES[constraint]}\n")
        for metric in METRICS:
            parts += [f"{_UNITS[metric]}:\n", *table_of(own, metric, config.seed).markdown(), ""]
        off = [row.value for row in own if row.metric == "pin_off_mm"]
        if off:
            parts.append(
                f"Pinned ends are at most {max(off):.2f} mm from their places (95% of them at most "
                f"{np.percentile(off, 95):.2f} mm).\n"
            )
    return "\n".join(parts) + "\n"


def terminal_lines(rows: Sequence[MetricRow], config: Config) -> list[str]:
    """One line for each constraint: the mean MPJPE of each method."""
    lines = []
    for constraint in config.constraints:
        shown = []
        for method in (PLAIN, FREE, CONSTRAINED):
            of = [row.value for row in rows if (row.task, row.method, row.metric) == (constraint, method, METRICS[0])]
            shown.append(f"{method} {np.mean(of):.1f}" if of else f"{method} not measured")
        lines.append(f"{constraint}: MPJPE in mm: {'; '.join(shown)}")
    return lines
