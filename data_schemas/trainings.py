"""What a checkpoint says of the trainings that its weights went through: fields of its `config.json`.

`config.json` of a `checkpoint` artefact holds the list `trainings`, the first training first; `write_checkpoint` and
`read_checkpoint` turn it into `Training` objects and back. What is shown to people (`TrainingData.sentence`) is made
from the fields and is never read back.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from typing import Any

from pydantic import BaseModel, ConfigDict

from data_schemas.clips import ClipRow

LOOSE_FILES = "loose files"  # how a sentence calls the recordings of folders


class TrainedArchive(BaseModel):
    """The clips of one archive, or of one folder of loose files, that a network was trained on.

    name:     file name of the archive, such as "walks.zip", or name of the folder; "" where the folder is not known.
    loose:    whether the clips were files in a folder.
    sha256:   sha256 over the sorted sha256 of the clips' sources; "" where one of these is not known.
    clips:    how many clips, and `seconds`, how long they are; None where only the training's total is known.
    licences: of the clips, sorted.
    """

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)

    name: str
    loose: bool = False
    sha256: str = ""
    clips: int | None = None
    seconds: float | None = None
    licences: list[str] = []


class TrainingData(BaseModel):
    """The clips that a network was trained on in one training.

    clips, seconds, skeletons: how many clips, how long they are together, on how many skeletons.
    archives: where the clips came from, sorted by name.
    """

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)

    clips: int
    seconds: float
    skeletons: int
    archives: list[TrainedArchive]

    @property
    def sentence(self) -> str:
        """One line for people."""
        names = ", ".join(sorted({LOOSE_FILES if each.loose else each.name for each in self.archives}))
        hours = self.seconds / 3600
        return f"{self.clips} clips, {hours:.2f} hours, {self.skeletons} skeletons, from {names}"

    def has_seen(self, row: ClipRow) -> bool:
        """Whether the clip's archive is one of these. A folder may have been renamed, so every loose file counts as
        seen where one was trained on."""
        if row.archive is None:
            return any(each.loose for each in self.archives)
        return any(not each.loose and each.name == row.archive for each in self.archives)

    def agrees_with(self, other: TrainingData) -> bool:
        """Whether both may be the same data; a sha256 that one of them does not know is not compared."""
        mine, theirs = (
            {LOOSE_FILES if each.loose else each.name: each.sha256 for each in data.archives}
            for data in (self, other)
        )
        return (
            (self.clips, self.skeletons) == (other.clips, other.skeletons)
            and mine.keys() == theirs.keys()
            and all(mine[name] == theirs[name] for name in mine if mine[name] and theirs[name])
        )


class Training(BaseModel):
    """One training: optimiser steps, minutes, and the data; None where nobody knows the data."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)

    steps: int
    minutes: float
    data: TrainingData | None = None


def training_data(rows: Sequence[ClipRow]) -> TrainingData:
    """The facts of clips that a network was trained on."""
    groups: dict[tuple[bool, str], list[ClipRow]] = {}
    for row in rows:
        name = _folder_name(row) if row.archive is None else row.archive
        groups.setdefault((row.archive is None, name), []).append(row)
    archives = [_archive(name, loose, members) for (loose, name), members in groups.items()]
    return TrainingData(
        clips=len(rows),
        seconds=round(sum(row.seconds for row in rows), 3),
        skeletons=len({row.skeleton for row in rows if row.skeleton}),
        archives=sorted(archives, key=lambda each: (each.name, each.loose)),
    )


def last_data(trainings: Sequence[Training]) -> TrainingData | None:
    """The data of the last training; None where it is not known."""
    return trainings[-1].data if trainings else None


def last_sentence(trainings: Sequence[Training]) -> str:
    """One line on the data of the last training; "" where they are not known."""
    data = last_data(trainings)
    return data.sentence if data is not None else ""


def plain_trainings(trainings: Iterable[Training]) -> list[dict[str, Any]]:
    """The trainings as JSON can hold them."""
    return [each.model_dump() for each in trainings]


def _folder_name(row: ClipRow) -> str:
    parts = row.source.replace("\\", "/").split("/")
    return parts[-2] if len(parts) > 1 else ""


def _archive(name: str, loose: bool, rows: Sequence[ClipRow]) -> TrainedArchive:
    digests = sorted({row.sha256 for row in rows})
    return TrainedArchive(
        name=name,
        loose=loose,
        sha256="" if "" in digests else hashlib.sha256("\n".join(digests).encode()).hexdigest(),
        clips=len(rows),
        seconds=round(sum(row.seconds for row in rows), 3),
        licences=sorted({row.licence for row in rows}),
    )
