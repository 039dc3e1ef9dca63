"""The `checkpoint` artefact: a trained network, and the state needed to continue its training.

Weights and optimiser are safetensors, config is JSON, the log is Parquet: reading them cannot run code. Arrays larger
than `SHARD_BYTES` together are split over several files, `model-00001-of-00003.safetensors` and so on, for hosts that
limit the size of a file; an array is never split.
"""

from __future__ import annotations

import io
import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from safetensors import SafetensorError
from safetensors.numpy import load_file, save

from data_schemas.damaged_files import reading
from data_schemas.declared_sizes import read_table
from data_schemas.disk import check_room
from data_schemas.errors import InputError
from data_schemas.kinds import KINDS
from data_schemas.manifest import Artefact, read_newest
from data_schemas.migrations import migrated_folder
from data_schemas.trainings import Training, plain_trainings

KIND = "checkpoint"
WEIGHTS_NAME = "model.safetensors"
OPTIMISER_NAME = "optimiser.safetensors"
CONFIG_NAME = "config.json"
LOG_NAME = "log.parquet"
CARD_NAME = "MODEL_CARD.md"
LAST = "last/"  # before the names of a training's last weights, where they are kept beside its best ones
TRAININGS = "trainings"  # key of `config.json`
SHARD_BYTES = 15 * 2**20
_MOST_SHARDS = 10_000
_HEADER_BYTES = 256  # of one array in a safetensors file, at most


@dataclass(frozen=True)
class Checkpoint:
    """A checkpoint in memory.

    weights:   parameter name -> array.
    config:    the network's settings, and other facts of its training; plain data.
    optimiser: name -> array of the optimiser's state, or None if it is not stored.
    log:       one mapping per logged step.
    card:      Markdown for people: what the network is, its training data and licences.
    trainings: the trainings that the weights went through, the first one first; kept in `config.json`.
    """

    weights: dict[str, np.ndarray]
    config: dict[str, Any]
    optimiser: dict[str, np.ndarray] | None
    log: list[dict[str, Any]]
    card: str
    trainings: tuple[Training, ...] = ()


def write_checkpoint(
    folder: str | os.PathLike[str],
    *,
    weights: Mapping[str, np.ndarray],
    config: Mapping[str, Any],
    optimiser: Mapping[str, np.ndarray] | None,
    log: Sequence[Mapping[str, Any]],
    card: str,
    trainings: Sequence[Training] = (),
) -> None:
    """Write a checkpoint's files into an existing folder (`Draft.folder`, or a folder of resumable work).

    Arrays are float32, float16 or any NumPy number; the same content gives the same bytes.
    """
    folder = Path(folder)
    check_room(folder, sum(array.nbytes for array in (*weights.values(), *(optimiser or {}).values())))
    _save(weights, folder / WEIGHTS_NAME)
    if optimiser is not None:
        _save(optimiser, folder / OPTIMISER_NAME)
    content = {**config, TRAININGS: plain_trainings(trainings)}
    (folder / CONFIG_NAME).write_text(json.dumps(content, indent=2, sort_keys=True) + "\n", encoding="utf-8")
    (folder / LOG_NAME).write_bytes(log_bytes(log))
    (folder / CARD_NAME).write_text(card, encoding="utf-8")


def log_bytes(log: Sequence[Mapping[str, Any]]) -> bytes:
    """Write a log as a Parquet file: one column per name, null where a row lacks it."""
    columns = sorted({name for entry in log for name in entry})
    table = pa.table({name: [entry.get(name) for entry in log] for name in columns})
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd")
    return buffer.getvalue()


def read_checkpoint(artefact: Artefact | str | os.PathLike[str], *, optimiser: bool = True) -> Checkpoint:
    """Read a checkpoint artefact.

    Args:
        artefact: an open artefact, or its path.
        optimiser: False does not read the optimiser's state (for using a network, not training it).

    Raises:
        InputError: missing, of another kind, newer than this pumps, or damaged.
    """
    return read_newest(artefact, KIND, lambda found: _read(found, optimiser))


def _read(found: Artefact, optimiser: bool) -> Checkpoint:
    if found.manifest.schema_version == KINDS[KIND].schema_version:
        return read_checkpoint_folder(found.folder, optimiser=optimiser)
    with tempfile.TemporaryDirectory(prefix="pumps-migrated-") as scratch:
        return read_checkpoint_folder(migrated_folder(found, Path(scratch)), optimiser=optimiser)


def read_checkpoint_folder(folder: str | os.PathLike[str], *, optimiser: bool = True) -> Checkpoint:
    """Read the files that `write_checkpoint` wrote into `folder`. Raises InputError if any is missing or damaged."""
    folder = Path(folder)
    with reading(folder / CONFIG_NAME):
        config = json.loads((folder / CONFIG_NAME).read_text(encoding="utf-8"))
        if not isinstance(config, dict):
            raise ValueError("it is not a mapping")
        trainings = tuple(Training.model_validate(each) for each in config.pop(TRAININGS, []))
    with reading(folder / LOG_NAME):
        log = [
            {name: value for name, value in entry.items() if value is not None}
            for entry in read_table(folder / LOG_NAME).to_pylist()
        ]
    with reading(folder / CARD_NAME):
        card = (folder / CARD_NAME).read_text(encoding="utf-8")
    return Checkpoint(
        weights=_load(folder / WEIGHTS_NAME),
        config=config,
        optimiser=_load(folder / OPTIMISER_NAME) if optimiser and _is_there(folder / OPTIMISER_NAME) else None,
        log=log,
        card=card,
        trainings=trainings,
    )


def _save(arrays: Mapping[str, np.ndarray], path: Path) -> None:
    shards = _in_shards(arrays)
    for number, names in enumerate(shards, 1):
        # safetensors writes the memory of a strided view in the wrong order, so every array is made contiguous first.
        content = {name: np.array(arrays[name], order="C") for name in names}
        # Made in memory and written here: a disk that is full is an OSError.
        (path if len(shards) == 1 else _shard(path, number, len(shards))).write_bytes(save(content))


def _in_shards(arrays: Mapping[str, np.ndarray]) -> list[list[str]]:
    """The arrays' sorted names, grouped into files that stay under the limit; an array is never split."""
    shards: list[list[str]] = [[]]
    size = 0
    for name in sorted(arrays):
        own = arrays[name].nbytes + len(name) + _HEADER_BYTES
        if shards[-1] and size + own > SHARD_BYTES:
            shards.append([])
            size = 0
        shards[-1].append(name)
        size += own
    return shards


def _shard(path: Path, number: int, count: int) -> Path:
    return path.with_name(f"{path.stem}-{number:05d}-of-{count:05d}{path.suffix}")


def _is_there(path: Path) -> bool:
    return path.exists() or any(path.parent.glob(f"{path.stem}-00001-of-*{path.suffix}"))


def _load(path: Path) -> dict[str, np.ndarray]:
    """The arrays of one file, or of all its shards. Raises InputError if any is missing or damaged."""
    first = sorted(path.parent.glob(f"{path.stem}-00001-of-*{path.suffix}"))
    if path.exists() or not first:
        return _load_file(path)
    count = first[0].stem.rpartition("-")[2]
    if len(first) > 1 or not count.isdecimal() or not 1 < int(count) < _MOST_SHARDS:
        raise InputError(f"{first[0]} is damaged: its name does not match its number of parts.", "Train it again.")
    arrays: dict[str, np.ndarray] = {}
    for number in range(1, int(count) + 1):
        arrays |= _load_file(_shard(path, number, int(count)))
    return arrays


def _load_file(path: Path) -> dict[str, np.ndarray]:
    with reading(path):
        try:
            return load_file(path)
        except SafetensorError as error:
            raise InputError(
                f"{path} is damaged: it is not a safetensors file ({error}).", "Run the stage that made it again."
            ) from None
