"""The page of a measurement of denoising: MPJPE, acceleration error and angles by category."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from data_schemas.metrics import MetricRow
from stages.measure.denoise.config import Config
from stages.measure.denoise.methods import MENDED, METRICS, NOISY
from stages.shared.settings.command_line import command_line
from stages.shared.statistics.category_tables import table_of

_TITLES = {
    "mpjpe_mm": "MPJPE, mm",
    "acceleration_mm": "Acceleration error, mm a frame squared",
    "mpjae_deg": "Error of rotations, degrees",
}


def summary_md(config: Config, rows: Sequence[MetricRow], widths: Mapping[str, float], tuned: int) -> str:
    """The whole page."""
    windows = sum(row.windows for row in rows if row.method == NOISY and row.metric == METRICS[0])
    clips = len({row.clip for row in rows})
    chosen = ", ".join(f"{name} {width:g}" for name, width in widths.items())
    how = f"with the least MPJPE on {tuned} windows of {', '.join(config.tuning_splits)}" if tuned else "by default"
    parts = [
        "# Denoising (PUMPS Table 4)\n",
        f"Made by:\n\n```\n{command_line('pumps measure denoise', config)}\n```\n",
        f"{clips} clips, {windows} windows of {config.window} frames at 30 fps, noise: {config.noise}. All methods "
        f"see the same noise. `{NOISY}`: nothing is done. `{MENDED}`: `pumps denoise` without a network. Filters' "
        f"widths, {how}: {chosen}. Means over windows; of all clips with a 95% bootstrap interval over clips.",
    ]
    for metric in METRICS:
        parts += [f"\n## {_TITLES[metric]}\n", *table_of(rows, metric, config.seed).markdown()]
    return "\n".join(parts) + "\n"


def terminal_lines(rows: Sequence[MetricRow], seed: int) -> list[str]:
    """One line a method: all clips together."""
    tables = [table_of(rows, metric, seed) for metric in METRICS]
    return [
        f"{row.labels[0]:24} MPJPE {row.entries[-1].text} mm, acceleration {two.entries[-1].text} mm/frame², "
        f"rotations {three.entries[-1].text} degrees"
        for row, two, three in zip(*(table.rows for table in tables), strict=True)
    ]
