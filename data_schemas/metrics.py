"""The `metrics` artefact: an evaluation. `metrics.parquet`, one row per value, and `summary.md` for people.

It may also keep the filled windows (`data_schemas.fills`)."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from tempfile import TemporaryDirectory

import pyarrow as pa
import pyarrow.parquet as pq

from data_schemas.damaged_files import reading
from data_schemas.declared_sizes import read_table
from data_schemas.errors import InputError
from data_schemas.manifest import Artefact, read_newest
from data_schemas.migrations import migrated_folder

KIND = "metrics"
METRICS_NAME = "metrics.parquet"
SUMMARY_NAME = "summary.md"


@dataclass(frozen=True)
class MetricRow:
    """One value: one metric of one method on one clip.

    archive:  the data set of the clip, named after its archive or folder.
    interval: frames between keys, or missing frames, depending on the task.
    metric:   the name of the metric's variant, such as "l2p_m" or "npss_lafan1".
    weight:   the clip's weight in an average over clips (NPSS: the power of the ground truth; 1 otherwise).
    windows:  number of windows of the clip over which the value is averaged.
    """

    clip: str
    skeleton: str
    archive: str
    method: str
    task: str
    interval: int
    metric: str
    value: float
    weight: float = 1.0
    windows: int = 1


_COLUMNS = pa.schema(
    [
        pa.field(name, {"int": pa.int64(), "float": pa.float64()}.get(kind, pa.string()), nullable=False)
        for name, kind in ((f.name, str(f.type)) for f in fields(MetricRow))
    ]
)


def write_metrics(folder: str | os.PathLike[str], rows: Iterable[MetricRow], summary_md: str) -> None:
    """Write the rows, in the order given, and the Markdown summary into an existing folder."""
    table = pa.Table.from_pylist([asdict(row) for row in rows], schema=_COLUMNS)
    pq.write_table(table, Path(folder) / METRICS_NAME, compression="zstd")
    (Path(folder) / SUMMARY_NAME).write_text(summary_md, encoding="utf-8")


def read_metrics(artefact: Artefact | str | os.PathLike[str]) -> tuple[list[MetricRow], str]:
    """Read a metrics artefact: its rows and its Markdown summary.

    Raises:
        InputError: missing, of another kind, newer than this pumps, or damaged.
    """
    return read_newest(artefact, KIND, _migrated)


def _migrated(found: Artefact) -> tuple[list[MetricRow], str]:
    with TemporaryDirectory(prefix="pumps-") as scratch:
        return _read(migrated_folder(found, Path(scratch)))


def _read(folder: Path) -> tuple[list[MetricRow], str]:
    path = folder / METRICS_NAME
    with reading(path):
        table = read_table(path)
        missing = sorted(set(_COLUMNS.names) - set(table.column_names))
        if missing:
            raise InputError(f"{path} is damaged: it lacks the columns {', '.join(missing)}.")
        rows = [MetricRow(**row) for row in table.select(_COLUMNS.names).cast(_COLUMNS).to_pylist()]
    with reading(folder / SUMMARY_NAME):
        summary = (folder / SUMMARY_NAME).read_text(encoding="utf-8")
    return rows, summary
