"""`pumps measure denoise`: noise on held-out windows, and how near each method comes to the truth (PUMPS Table 4)."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.errors import InputError
from data_schemas.manifest import open_artefact
from data_schemas.metrics import MetricRow, write_metrics
from data_schemas.motion import MotionReader
from stages.measure.denoise.config import Config
from stages.measure.denoise.methods import METRICS, figures, methods_of, tuned_widths
from stages.measure.denoise.summary import summary_md, terminal_lines
from stages.measure.denoise.windows import noisy_windows
from stages.shared.contract import StageReport
from stages.shared.kinematics.motion_filters import FILTERS
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.weights.shipped import named_source

TASK = "denoising"


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Measure every method on the same noisy windows and write a `metrics` artefact.

    Raises: UsageError for an unknown noise or two methods of one name; InputError if no clip is long enough, or a
        network's rig is not among the clips.
    """
    check_artefact(config, "metrics")
    with MotionReader(config.motion) as reader:
        progress.start("choosing the filters' widths")
        widths, tuned = _widths(reader, config)
        methods = methods_of(config, widths)
        windows = list(noisy_windows(reader, config, config.splits))
        progress.start("denoising", len(windows))
        found: dict[tuple[str, str, str, str], list[tuple[float, ...]]] = defaultdict(list)
        for window in windows:
            for name, clean in methods.items():
                made = clean(window.skeleton, window.noisy)
                if made is not None:
                    place = (window.row.clip, window.row.skeleton, window.category, name)
                    found[place].append(figures(window, made))
            progress.advance(1, window.category)
        inputs = [reader.artefact, *(open_artefact(named_source(text)[1], "checkpoint") for text in config.weights)]
    idle = sorted(methods.keys() - {place[3] for place in found})
    if idle:
        raise InputError(f"No clip is of the rig of the network {idle[0]}.", "Measure it on clips of its own rig.")
    rows = [
        MetricRow(*place, TASK, config.window, metric, float(value), windows=len(values))
        for name in methods
        for place, values in found.items()
        if place[3] == name
        for metric, value in zip(METRICS, np.mean(values, axis=0), strict=True)
    ]
    facts = {"windows": len(windows), "methods": list(methods), "widths": widths, "tuned_windows": tuned}
    with write_artefact(config.output, "metrics", stage="measure-denoise", config=config, inputs=inputs) as draft:
        draft.summary.update(facts)
        write_metrics(draft.folder, rows, summary_md(config, rows, widths, tuned))
    return StageReport(
        output=config.output,
        lines=[*terminal_lines(rows, config.seed), f"Full tables: {config.output}, summary.md."],
        figures=facts,
    )


def _widths(reader: MotionReader, config: Config) -> tuple[dict[str, float], int]:
    """The filters' widths, and the number of windows on which they were chosen; 0 where there are none."""
    try:
        windows = list(noisy_windows(reader, config, config.tuning_splits))
    except InputError:
        return {name: 1.0 for name in FILTERS}, 0
    return tuned_widths(windows), len(windows)
