"""Spectra of filled windows beside the truth: how much of a motion happens how fast. Charts, and a table of bands."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from data_schemas.fills import FilledBatch, kept_joints
from stages.report.filled_windows import FilledWindows, task_title, tasks_of
from stages.report.line_charts import line_chart
from stages.report.results import table_html
from stages.shared.markup import Markup, markup
from stages.shared.statistics.measurements import TRUTH, measured_joints
from stages.shared.statistics.spectra import BANDS_HZ, band_power, velocity_density
from stages.shared.statistics.table import Entry, Row, Table, without_repeats

TICKS_HZ = (0.0, 3.0, 6.0, 9.0, 12.0, 15.0)
_LEAST_BINS = 128
LEGEND = (
    "Power spectral density of the joints' velocities, (m/s)²/Hz over Hz: mean over the measured joints and all "
    "windows, the known frames among them. Below the truth's line a motion is too smooth, above it it shakes. The "
    "table has the power in a band as a share of the truth's; 1 is right."
)


def spectra_html(fills: FilledWindows) -> Markup:
    """A chart for each task and interval, and the table."""
    charts: list[Markup] = []
    rows: list[Row] = []
    methods = list(dict.fromkeys(name for batch in fills.batches for name in fills.methods(batch) if name != TRUTH))
    for task, interval, batches in tasks_of(fills):
        frequencies, densities = densities_of(fills, batches)
        title, shown = task_title(task, interval), frequencies <= TICKS_HZ[-1]
        lines = {
            name: [(float(x), float(y)) for x, y in zip(frequencies[shown], density[shown], strict=True) if y > 0]
            for name, density in densities.items()
        }
        if lines := {name: line for name, line in lines.items() if line}:  # windows may all be still
            charts.append(line_chart(title, lines, TICKS_HZ, methods))
        for name in methods:
            if name in densities:
                shares = (_share(frequencies, densities[name], densities[TRUTH], band) for band in BANDS_HZ)
                rows.append(Row((title, name), tuple(shares)))
    columns = tuple(f"{first:g} to {last:g} Hz" for first, last in BANDS_HZ)
    return markup(
        '<section id="spectra"><h2>Spectra</h2><p>{}</p><div class="curves">{}</div><details><summary>{}</summary>{}'
        "</details></section>",
        LEGEND, charts, "Power as a share of the truth's",
        table_html(Table(("task", "method"), columns, without_repeats(rows))),
    )  # fmt: skip


def densities_of(fills: FilledWindows, batches: Sequence[FilledBatch]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Frequencies (F,) in Hz, and each method's mean density (F,) over the windows of the batches."""
    longest = max(len(batch.known) for batch in batches)
    bins = max(_LEAST_BINS, 1 << (longest - 1).bit_length())
    frequencies = np.zeros(0)
    total: dict[str, np.ndarray] = {}
    windows: dict[str, int] = {}
    for batch in batches:
        skeleton = fills.skeleton(batch)
        measured = np.searchsorted(kept_joints(skeleton), measured_joints(skeleton))
        for method in fills.methods(batch):
            positions, _ = fills.poses(batch, method)
            frequencies, density = velocity_density(positions[:, :, measured], fills.fps, bins)
            total[method] = total.get(method, 0.0) + density.sum(axis=0)
            windows[method] = windows.get(method, 0) + len(density)
    return frequencies, {method: total[method] / windows[method] for method in total}


def _share(frequencies: np.ndarray, density: np.ndarray, true: np.ndarray, band: tuple[float, float]) -> Entry:
    of_truth = band_power(frequencies, true, band)
    return Entry(f"{band_power(frequencies, density, band) / of_truth:.2f}" if of_truth > 0 else "")
