"""Reading older versions of artefacts, through one migration function for each step.

When the layout of a kind changes, raise its version in `kinds.py` and register here the function that converts the
old layout to the new one. An artefact on the disk is never changed: readers migrate into a scratch folder.
"""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from data_schemas.declared_sizes import read_table
from data_schemas.disk import disk_faults_reported
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
            with disk_faults_reported(scratch):
                step(folder, target)
        except (OSError, ValueError, KeyError, TypeError, AttributeError, pa.ArrowException) as error:
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
    table = read_table(source / "clips.parquet")
    flags = pa.array([""] * table.num_rows, pa.string())
    pq.write_table(table.append_column("flags", flags), target / "clips.parquet")


def _clips_1_to_2(source: Path, target: Path) -> None:
    """Version 2 added columns for measures of a clip's quality; they are empty for older clips."""
    for path in source.iterdir():
        if path.name != "clips.parquet":
            carry_over(source, target, path.name)
    table = read_table(source / "clips.parquet")
    for name, value in asdict(MotionQuality()).items():
        kind = pa.float64() if value is None else None
        table = table.append_column(name, pa.array([value] * table.num_rows, kind))
    pq.write_table(table, target / "clips.parquet")


def _motion_2_to_3(source: Path, target: Path) -> None:
    """Version 3 has the codes of what was odd of each source; of older ones the sentences alone are known."""
    for path in source.iterdir():
        if path.name != "sources.parquet":
            carry_over(source, target, path.name)
    if (source / "sources.parquet").exists():
        table = read_table(source / "sources.parquet")
        flags = pa.array([""] * table.num_rows, pa.string())
        pq.write_table(table.append_column("flags", flags), target / "sources.parquet")


def _tpc_2_to_3(source: Path, target: Path) -> None:
    """Version 3 added packed clips; older artefacts have none."""
    for path in source.iterdir():
        carry_over(source, target, path.name)


def _metrics_1_to_2(source: Path, target: Path) -> None:
    """Version 2 states velocity jumps in metres per second; before, in millimetres per frame at 30 fps."""
    carry_over(source, target, "summary.md")
    table = read_table(source / "metrics.parquet")
    rows = table.to_pylist()
    for row in rows:
        if row["metric"] == "key_jump_mm":
            row.update(metric="key_jump_mps", value=row["value"] * 30 / 1000)
    pq.write_table(pa.Table.from_pylist(rows, schema=table.schema), target / "metrics.parquet")


def _metrics_2_to_3(source: Path, target: Path) -> None:
    """Version 3 may keep the filled windows; older artefacts have none."""
    for path in source.iterdir():
        carry_over(source, target, path.name)


def _checkpoint_1_to_2(source: Path, target: Path) -> None:
    """Version 2 lists the data of every training as fields (`data_schemas.trainings`); before, each training and the
    whole had a sentence about them, `trained_on`. Weights that listed no training get one, made from their log."""
    for path in source.iterdir():
        if path.name != "config.json":
            carry_over(source, target, path.name)
    config = json.loads((source / "config.json").read_text(encoding="utf-8"))
    last = str(config.pop("trained_on", ""))
    trainings = config.get("trainings") or ([_training_of_log(source)] if last else [])
    sentences = [str(each.pop("trained_on", last)) for each in trainings]
    config["trainings"] = [
        {**each, "data": _data_of_sentence_1(sentence)} for each, sentence in zip(trainings, sentences, strict=True)
    ]
    (target / "config.json").write_text(json.dumps(config), encoding="utf-8")


def _training_of_log(folder: Path) -> dict[str, Any]:
    """Steps and minutes of a training, from the last row of its log."""
    rows = read_table(folder / "log.parquet").to_pylist()
    last = rows[-1] if rows else {}
    return {"steps": last.get("step") or 0, "minutes": round((last.get("seconds") or 0) / 60, 1)}


_SENTENCE_1 = re.compile(
    r"(\d{1,18}) clips, (\d+\.\d+) hours, (\d+) skeletons, from (.*?)(?=; \d+ clips, |\Z)", re.DOTALL
)
_ARCHIVE_ENDS_1 = (".zip", ".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tbz2", ".tbz", ".tar.xz", ".txz")
_LOOSE_1 = "loose files"


def _data_of_sentence_1(sentence: str) -> dict[str, Any] | None:
    """The fields of version 2 from the sentence of version 1, or from several that `train skeleton` joined by "; ".

    This is the one place that reads the sentence, for checkpoints of version 1 alone. None where it is no such one.
    """
    found = [match.groups() for match in _SENTENCE_1.finditer(sentence)]
    if not found:
        return None
    names = sorted({name for *_, listed in found for name in _names_of_list_1(listed)})
    return {
        "clips": sum(int(clips) for clips, *_ in found),
        "seconds": round(3600 * sum(float(hours) for _, hours, *_ in found), 3),
        "skeletons": sum(int(skeletons) for _, _, skeletons, _ in found),
        "archives": [
            {"name": "" if name == _LOOSE_1 else name, "loose": name == _LOOSE_1}  # the folder was not recorded
            for name in names
        ],
    }


def _names_of_list_1(listed: str) -> list[str]:
    """Names that were joined by ", ": each ends as an archive does, so that a comma within a name is known as one."""
    names: list[str] = []
    started = ""
    for part in listed.split(", "):
        started = f"{started}, {part}" if started else part
        if started == _LOOSE_1 or part.lower().endswith(_ARCHIVE_ENDS_1):
            names.append(started.replace("\\", "/").rsplit("/", 1)[-1])
            started = ""
    return [*names, started] if started else names


MIGRATIONS: dict[tuple[str, int], Migration] = {
    ("motion", 0): _motion_0_to_1,
    ("motion", 1): _clips_1_to_2,
    ("motion", 2): _motion_2_to_3,
    ("tpc", 1): _clips_1_to_2,
    ("tpc", 2): _tpc_2_to_3,
    ("latent", 1): _clips_1_to_2,
    ("metrics", 1): _metrics_1_to_2,
    ("metrics", 2): _metrics_2_to_3,
    ("checkpoint", 1): _checkpoint_1_to_2,
}
