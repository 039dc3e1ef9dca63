"""`pumps results`: the table of a metrics artefact."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pumps_cli.outcome import Manner, errors_reported, show
from pumps_cli.stage_command import AsJson, Debug, Quiet

EXAMPLE = "Example: pumps results runs/demo/evaluate"


def command(
    metrics: Annotated[Path, typer.Argument(help="Folder of the metrics artefact.")],
    quiet: Quiet = False,
    as_json: AsJson = False,
    debug: Debug = False,
) -> None:
    """Print the table of a metrics artefact; of one that measures no filling, its whole page."""
    # Only now: the modules behind these names are slow to load, and help must not wait for them.
    from dataclasses import asdict

    from data_schemas.manifest import open_artefact
    from data_schemas.metrics import read_metrics
    from stages.shared.statistics.feel_tables import feel_lines
    from stages.shared.statistics.measurements import METRICS
    from stages.shared.statistics.pop_tables import pop_lines
    from stages.shared.statistics.tables import cells, terminal_lines
    from stages.shared.statistics.tasks import OF_PAGES

    manner = Manner(quiet=quiet, json=as_json, debug=debug)
    with errors_reported(manner, "pumps results"):
        rows, page = read_metrics(open_artefact(metrics, "metrics"))
        filling = all(row.metric in METRICS and row.task not in OF_PAGES for row in rows)
        found = cells(rows) if filling else {}
        tables = lambda: [*terminal_lines(found), *feel_lines(found), *pop_lines(rows)]  # noqa: E731
        show(manner, tables if filling else page.splitlines, lambda: [asdict(row) for row in rows])
