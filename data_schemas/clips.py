"""The common parts of artefacts of clips (motion, tpc, latent): the index, and an HDF5 file with a group per clip."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from data_schemas.damaged_files import reading
from data_schemas.declared_sizes import read_table
from data_schemas.errors import InputError
from data_schemas.hdf5_arrays import group_in
from data_schemas.hdf5_writing import NewHdf5
from data_schemas.kinds import KINDS
from data_schemas.manifest import Artefact, read_newest
from data_schemas.migrations import migrated_folder
from data_schemas.quality import MotionQuality

CLIPS_NAME = "clips.parquet"
SPLITS = ("train", "val", "test")


@dataclass(frozen=True)
class ClipRow:
    """One clip in the index of an artefact.

    clip:     its name, unique in the artefact.
    source:   the file it was read from: a path, or "archive.zip!member".
    sha256:   of the source's bytes.
    skeleton: id of its skeleton in the motion artefact; "" for clouds that have none.
    frames:   number of frames, at `fps` frames per second; `seconds` = frames / fps.
    split:    "train", "val" or "test".
    licence:  of the source.
    flags:    its oddities and the changes that ingest made to it, codes of `data_schemas.notes` separated by spaces.
    quality:  measures that ingest took of it; each is a column of its own.
    """

    clip: str
    source: str
    sha256: str
    skeleton: str
    frames: int
    fps: float
    seconds: float
    split: str
    licence: str
    flags: str = ""
    quality: MotionQuality = field(default_factory=MotionQuality)

    @property
    def archive(self) -> str | None:
        """File name of the archive that it came from, such as "walks.zip"; None for a loose file."""
        archive, mark, _ = self.source.replace("\\", "/").partition("!")
        return archive.rsplit("/", 1)[-1] if mark else None


_TYPES = {"int": pa.int64(), "float": pa.float64(), "bool": pa.bool_(), "str": pa.string()}
_FIELDS = [each for each in fields(ClipRow) if each.name != "quality"]
_INDEX = pa.schema(
    [
        pa.field(each.name, _TYPES[str(each.type).removesuffix(" | None")], nullable="None" in str(each.type))
        for each in (*_FIELDS, *fields(MotionQuality))
    ]
)


def index_table(rows: Sequence[ClipRow]) -> pa.Table:
    """The index as a table: one row per clip, each measure of its quality a column."""
    flat = [{f.name: getattr(row, f.name) for f in _FIELDS} | asdict(row.quality) for row in rows]
    return pa.Table.from_pylist(flat, schema=_INDEX)


def _row_of(values: dict[str, Any]) -> ClipRow:
    quality = MotionQuality(**{each.name: values.pop(each.name) for each in fields(MotionQuality)})
    return ClipRow(**values, quality=quality)


def write_clips(folder: Path, rows: list[ClipRow]) -> None:
    """Write the index `clips.parquet` into `folder`, rows in the order given."""
    pq.write_table(index_table(rows), folder / CLIPS_NAME, compression="zstd")


def read_clips(folder: Path) -> tuple[ClipRow, ...]:
    """Read the index of `folder`. Raises InputError if it is missing, damaged or holds impossible values."""
    path = folder / CLIPS_NAME
    with reading(path):
        table = read_table(path)
        missing = sorted(set(_INDEX.names) - set(table.column_names))
        if missing:
            raise InputError(f"{path} is damaged: it lacks the columns {', '.join(missing)}.")
        table = table.select(_INDEX.names).cast(_INDEX)
        different = len(table.column("clip").unique())
        if different < table.num_rows:  # before a row of each is made
            raise InputError(f"{path} is damaged: it names {table.num_rows - different} clips twice.")
        rows = tuple(_row_of(row) for row in table.to_pylist())
    for row in rows:
        fault = _fault_of(row)
        if fault:
            raise InputError(f"{path} is damaged: it {fault}.")
    return rows


def _fault_of(row: ClipRow) -> str | None:
    name = row.clip
    if not name or name in (".", "..") or "/" in name or not name.isprintable() or len(name) > 500:
        return f"names a clip {name[:100]!r}, but a clip's name must be printable text without '/'"
    if row.frames < 1:
        return f"gives the clip {name!r} {row.frames} frames"
    if not (np.isfinite(row.fps) and row.fps > 0):
        return f"gives the clip {name!r} {row.fps} frames a second"
    if row.split not in SPLITS:
        return f"puts the clip {name!r} into the split {row.split!r}, and there are {', '.join(SPLITS)}"
    return None


_Self = TypeVar("_Self", bound="ClipWriter")
_Reader = TypeVar("_Reader", bound="ClipReader")


class ClipWriter:
    """Base of the writers: an HDF5 file with groups `/clips/<clip>`; `close` writes the index.

    Raises: OSError, from each method that writes, if the disk is full.
    """

    FILE: ClassVar[str]

    def __init__(self, folder: str | os.PathLike[str], *, libver: str | None = None):
        self._folder = Path(folder)
        self._rows: dict[str, ClipRow] = {}
        self._new = NewHdf5(self._folder / self.FILE, libver=libver)
        self._file = self._new.file
        self._clips = self._file.create_group("clips")

    def _new_clip(self, row: ClipRow, frames: int) -> h5py.Group:
        fault = _fault_of(row)
        if fault is None and row.clip in self._rows:
            fault = f"names the clip {row.clip!r} twice"
        if fault is None and row.frames != frames:
            fault = f"gives the clip {row.clip!r} {row.frames} frames, but its arrays have {frames}"
        if fault:
            raise InputError(f"The index {fault}.")
        self._new.check()
        self._rows[row.clip] = row
        return self._clips.create_group(row.clip)

    def close(self) -> None:
        """Write the index and close the file. Without this call the artefact is incomplete."""
        if self._file:
            self._new.close()
            write_clips(self._folder, list(self._rows.values()))

    def __enter__(self: _Self) -> _Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        if kind is None:
            self.close()
        else:
            self._new.discard()


class ClipReader:
    """Base of the readers: opens the artefact (an older version through its migrations) and reads its index.

    Args:
        artefact: an open artefact, or its path.

    Raises:
        InputError: missing, of another kind, newer than this pumps, or damaged.
    """

    KIND: ClassVar[str]
    FILE: ClassVar[str]

    clips: tuple[ClipRow, ...]

    def __init__(self, artefact: Artefact | str | os.PathLike[str]):
        read_newest(artefact, self.KIND, self._open)

    def _open(self, artefact: Artefact) -> None:
        self.artefact = artefact
        older = artefact.manifest.schema_version < KINDS[self.KIND].schema_version
        self._scratch = tempfile.TemporaryDirectory(prefix="pumps-migrated-") if older else None
        try:
            self.folder = migrated_folder(artefact, Path(self._scratch.name)) if self._scratch else artefact.folder
            self.clips = read_clips(self.folder)
            self._rows = {row.clip: row for row in self.clips}
            self._path = self.folder / self.FILE
            with reading(self._path):
                # An artefact's files never change, so no lock is needed (and some file systems have none).
                self._file = h5py.File(self._path, "r", locking=False)
        except BaseException:
            self._clean()
            raise

    @property
    def stored_bytes(self) -> int:
        """Size of the HDF5 file."""
        return self._path.stat().st_size

    def row(self, clip: str) -> ClipRow:
        """The index row of a clip. Raises InputError for an unknown name."""
        try:
            return self._rows[clip]
        except KeyError:
            raise InputError(
                f"{self.artefact.path} has no clip {clip!r}.", "`pumps artefact show` counts its clips."
            ) from None

    def _window(self, row: ClipRow, start: int, stop: int | None) -> slice:
        end = row.frames if stop is None else stop
        if not 0 <= start < end <= row.frames:
            raise InputError(
                f"The frames {start} to {end} are outside the clip {row.clip!r}, which has {row.frames} frames."
            )
        return slice(start, end)

    def _group(self, row: ClipRow) -> h5py.Group:
        return group_in(group_in(self._file, "clips"), row.clip)

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        self._clean()

    def _clean(self) -> None:
        if self._scratch is not None:
            self._scratch.cleanup()

    def __enter__(self: _Reader) -> _Reader:
        return self

    def __exit__(self, *rest: object) -> None:
        self.close()

    def __reduce__(self) -> tuple[Any, ...]:
        # An open HDF5 file cannot be sent to a worker process, so the worker opens the artefact again.
        return type(self), (self.artefact,)
