"""`pumps measure pcmrl`: the measurements of PC-MRL's three tables, on given motions."""

from __future__ import annotations

from contextlib import ExitStack

from data_schemas.artefact import write_artefact
from data_schemas.manifest import Artefact
from data_schemas.metrics import MetricRow, write_metrics
from data_schemas.tpc import TpcReader
from stages.measure.pcmrl.config import Config
from stages.measure.pcmrl.interpolation import PLAIN, interpolation_rows
from stages.measure.pcmrl.retargeting import ORIGINAL, retargeting_rows
from stages.measure.pcmrl.summary import summary_md
from stages.shared.contract import StageReport
from stages.shared.inference.pose_filling import load_interpolator
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.statistics.categories import named
from stages.shared.statistics.tables import cells, terminal_lines


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Measure and write a `metrics` artefact.

    Raises:
        InputError: an artefact is bad, or has no clip that is long enough; a checkpoint is for another hierarchy.
        UsageError: a NAME=VALUE has another form, or two rows have the same name.
    """
    check_artefact(config, "metrics")
    interpolators = {
        name: load_interpolator(path, config.device)
        for name, path in named("weights", config.weights, [*PLAIN]).items()
    }
    inputs: list[Artefact] = [each.artefact for each in interpolators.values()]
    rows: list[MetricRow] = []
    with ExitStack() as opened:

        def open_clouds(path: object) -> TpcReader:
            reader = opened.enter_context(TpcReader(str(path)))
            inputs.append(reader.artefact)
            return reader

        truth = None if config.truth is None else open_clouds(config.truth)
        if truth is not None:
            rows += interpolation_rows(truth, interpolators, config, progress)
        if config.source is not None:
            source = open_clouds(config.source)
            adapted = {name: open_clouds(path) for name, path in named("adapted", config.adapted, [ORIGINAL]).items()}
            rows += retargeting_rows(source, adapted, config, progress)
        page = summary_md(config, rows, truth, interpolators)
    counts = {"clips": len({row.clip for row in rows}), "methods": list(dict.fromkeys(row.method for row in rows))}
    with write_artefact(config.output, "metrics", stage="measure-pcmrl", config=config, inputs=inputs) as draft:
        draft.summary.update(counts)
        write_metrics(draft.folder, rows, page)
    lines = [
        *terminal_lines(cells(rows, config.seed)),
        f"Full tables beside the paper's: {config.output}, summary.md.",
    ]
    return StageReport(output=config.output, lines=lines, figures=counts)
