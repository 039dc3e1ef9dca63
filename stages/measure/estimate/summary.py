"""The page of a measurement: MPJPE and MPJVE by category, and the paper's Table 3 beside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from data_schemas.metrics import MetricRow
from stages.measure.estimate.config import Config
from stages.shared.inference.pose_model import PoseModel
from stages.shared.settings.command_line import command_line
from stages.shared.statistics.category_tables import table_of

REST = "rest pose"
METRICS = ("mpjpe_mm", "mpjve_mm", "root_mm")
_TITLES = {
    "mpjpe_mm": "MPJPE, mm",
    "mpjve_mm": "MPJVE, mm a frame",
    "root_mm": "Error of the root's path, mm",
}


def summary_md(config: Config, rows: Sequence[MetricRow], models: Mapping[str, PoseModel]) -> str:
    """The whole page."""
    windows = sum(row.windows for row in rows if row.method == REST and row.metric == METRICS[0])
    clips = len({row.clip for row in rows})
    corruption = next(iter(models.values())).task.corruption
    parts = [
        "# Estimation from 2D keypoints (PUMPS Table 3)\n",
        f"Made by:\n\n```\n{command_line('pumps measure estimate', config)}\n```\n",
        f"{clips} clips, {windows} windows of {config.window} frames at 30 fps; keypoints: {corruption}. Positions "
        "are relative to the root, in the frame that the camera looks along, level. All methods see the same "
        "cameras. Means over windows; of all clips with a 95% bootstrap interval over clips. "
        f"`{REST}`: no network.\n",
        "\n".join(
            f"- {name}: {sum(value.numel() for value in model.network.parameters()) / 1e6:.2f} M parameters, trained "
            f"on {model.trained_on}."
            for name, model in models.items()
        ),
    ]
    for metric in METRICS:
        parts += [f"\n## {_TITLES[metric]}\n", *table_of(rows, metric, config.seed).markdown()]
    return "\n".join(parts) + "\n"


def terminal_lines(rows: Sequence[MetricRow], seed: int) -> list[str]:
    """One line a method: MPJPE and MPJVE over all clips."""
    tables = [table_of(rows, metric, seed) for metric in METRICS[:2]]
    return [
        f"{one.labels[0]:16} MPJPE {one.entries[-1].text} mm, MPJVE {other.entries[-1].text} mm a frame"
        for one, other in zip(tables[0].rows, tables[1].rows, strict=True)
    ]
