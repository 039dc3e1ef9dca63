"""`sources.parquet` of a `motion` artefact: the outcome of every file that ingest found, one row each.

Artefacts of early versions have no such table.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from data_schemas.damaged_files import reading
from data_schemas.declared_sizes import read_table
from data_schemas.errors import InputError

SOURCES_NAME = "sources.parquet"
OUTCOMES = ("kept", "repaired", "skipped", "ignored")


@dataclass(frozen=True)
class SourceRow:
    """One file.

    source:  a path, or "archive.zip!member".
    format:  its format ("bvh", "amass", ...); "" if it was not recognised.
    outcome: "kept" unchanged, "repaired", "skipped" (bad, or not a humanoid), "ignored" (not a recording).
    reason:  what was repaired, or why it was not used; else "".
    remarks: assumptions about facts that no file states.
    flags:   the codes of both (`data_schemas.notes`), separated by spaces; "" if it was not used.
    clips, frames: number of each read from it. bytes: its size, unpacked. sha256: of its bytes, "" if not read.
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
    flags: str = ""


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
    """The table of `folder`; no rows if the artefact has no table. Raises InputError if it is damaged."""
    path = folder / SOURCES_NAME
    if not path.exists():
        return ()
    with reading(path):
        table = read_table(path)
        missing = sorted(set(_TABLE.names) - set(table.column_names))
        if missing:
            raise InputError(f"{path} is damaged: it lacks the columns {', '.join(missing)}.")
        rows = tuple(SourceRow(**row) for row in table.select(_TABLE.names).cast(_TABLE).to_pylist())
    if any(row.outcome not in OUTCOMES for row in rows):
        raise InputError(f"{path} is damaged: an outcome is not one of {', '.join(OUTCOMES)}.")
    return rows


def _storable(text: str) -> str:
    """A file name as valid text for a table; bytes that are not text are replaced."""
    return text.encode("utf-8", errors="backslashreplace").decode()
