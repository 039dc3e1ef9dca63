"""Reading older versions of artefacts, through one migration function for each step.

When the layout of a kind changes, raise its version in `kinds.py` and register here the function that converts the
old layout to the new one. An artefact on the disk is never changed: readers migrate into a scratch folder.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from data_schemas.errors import InputError
from data_schemas.kinds import KINDS
from data_schemas.manifest import Artefact
from data_schemas.quality import MotionQuality

Migration = Callable[[Path, Path], None]


def migrated_folder(artefact: Artefact, scratch: Path) -> Path:
    """The artefact's data in the current layout: its own folder, or one under `scratch` that migrations filled.

    Raises:
        InputError: no migration leads from its version to the current one, or its data are damaged.
    """
    kind, version = artefact.manifest.kind, artefact.manifest.schema_version
    folder = artefact.folder
    while version < KINDS[kind].schema_version:
        step = MIGRATIONS.get((kind, version))
        if step is None:
            raise InputError(
                f"{artefact.path} is a {kind!r} artefact of version {version}, which pumps no longer reads.",
                "Run the stage that made it again.",
            )
        version += 1
        target = scratch / f"version-{version}"
        target.mkdir()
        try:
            step(folder, target)
        except (OSError, ValueError, KeyError, pa.ArrowException) as error:
            raise InputError(
                f"{artefact.path} is damaged: its data of version {version - 1} cannot be read ({error}).",
                "Run the stage that made it again.",
            ) from None
        folder = target
    return folder


def carry_over(source: Path, target: Path, name: str) -> None:
    """Put the unchanged file `name` into `target` too, as a link if possible, else as a copy."""
    with suppress(OSError, NotImplementedError):
        os.symlink((source / name).resolve(), target / name)
        return
    shutil.copyfile(source / name, target / name)


def _motion_0_to_1(source: Path, target: Path) -> None:
    """Version 1 added the column `flags`, the changes that ingest made to a clip; it is empty for older clips."""
    carry_over(source, target, "motions.h5")
    table = pq.ParquetFile(source / "clips.parquet").read()
    flags = pa.array([""] * table.num_rows, pa.string())
    pq.write_table(table.append_column("flags", flags), target / "clips.parquet")


def _clips_1_to_2(source: Path, target: Path) -> None:
    """Version 2 added columns for measures of a clip's quality; they are empty for older clips."""
    for path in source.iterdir():
        if path.name != "clips.parquet":
            carry_over(source, target, path.name)
    table = pq.ParquetFile(source / "clips.parquet").read()
    for name, value in asdict(MotionQuality()).items():
        kind = pa.float64() if value is None else None
        table = table.append_column(name, pa.array([value] * table.num_rows, kind))
    pq.write_table(table, target / "clips.parquet")


def _tpc_2_to_3(source: Path, target: Path) -> None:
    """Version 3 added packed clips; older artefacts have none."""
    for path in source.iterdir():
        carry_over(source, target, path.name)


def _metrics_1_to_2(source: Path, target: Path) -> None:
    """Version 2 states velocity jumps in metres per second; before, in millimetres per frame at 30 fps."""
    carry_over(source, target, "summary.md")
    table = pq.ParquetFile(source / "metrics.parquet").read()
    rows = table.to_pylist()
    for row in rows:
        if row["metric"] == "key_jump_mm":
            row.update(metric="key_jump_mps", value=row["value"] * 30 / 1000)
    pq.write_table(pa.Table.from_pylist(rows, schema=table.schema), target / "metrics.parquet")


MIGRATIONS: dict[tuple[str, int], Migration] = {
    ("motion", 0): _motion_0_to_1,
    ("motion", 1): _clips_1_to_2,
    ("tpc", 1): _clips_1_to_2,
    ("tpc", 2): _tpc_2_to_3,
    ("latent", 1): _clips_1_to_2,
    ("metrics", 1): _metrics_1_to_2,
}
