"""`sources.parquet` of a `motion` artefact: what became of every file that ingest met, one row each.

Artefacts made before the table was kept have none.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from data_schemas.damaged_files import reading
from data_schemas.errors import InputError

SOURCES_NAME = "sources.parquet"
OUTCOMES = ("kept", "repaired", "skipped", "ignored")


@dataclass(frozen=True)
class SourceRow:
    """One file.

    source:  a path, or "archive.zip!member".
    format:  how it was read ("bvh", "amass", ...); "" where nothing was recognised.
    outcome: "kept" as it is, "repaired", "skipped" (bad, or no humanoid), "ignored" (no recording at all).
    reason:  what was mended, or why it was not used; "" where there is nothing to say.
    remarks: what was taken for granted, since no file says it.
    clips, frames: made of it. bytes: its size, unpacked. sha256: of its bytes, "" where they were not read.
    """

    source: str
    format: str
    outcome: str
    reason: str
    remarks: str
    clips: int
    frames: int
    bytes: int
    sha256: str


_TABLE = pa.schema(
    [
        pa.field(each.name, pa.int64() if str(each.type) == "int" else pa.string(), nullable=False)
        for each in fields(SourceRow)
    ]
)


def write_sources(folder: Path, rows: list[SourceRow]) -> None:
    """Write `sources.parquet` into `folder`, rows in the order given."""
    plain = [{k: v if isinstance(v, int) else _storable(v) for k, v in asdict(row).items()} for row in rows]
    pq.write_table(pa.Table.from_pylist(plain, schema=_TABLE), folder / SOURCES_NAME, compression="zstd")


def read_sources(folder: Path) -> tuple[SourceRow, ...]:
    """The table of `folder`; no rows where the artefact keeps none. Raises InputError if it is damaged."""
    path = folder / SOURCES_NAME
    if not path.exists():
        return ()
    with reading(path):
        table = pq.ParquetFile(path).read()
        missing = sorted(set(_TABLE.names) - set(table.column_names))
        if missing:
            raise InputError(f"{path} is damaged: it lacks the columns {', '.join(missing)}.")
        rows = tuple(SourceRow(**row) for row in table.select(_TABLE.names).cast(_TABLE).to_pylist())
    if any(row.outcome not in OUTCOMES for row in rows):
        raise InputError(f"{path} is damaged: an outcome is none of {', '.join(OUTCOMES)}.")
    return rows


def _storable(text: str) -> str:
    """File names may hold bytes that are no text; a table holds text alone."""
    return text.encode("utf-8", errors="backslashreplace").decode()
