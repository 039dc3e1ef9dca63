"""What is said of a method whose weights are one checkpoint."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError
from data_schemas.manifest import MANIFEST_NAME, open_artefact
from data_schemas.trainings import TrainingData, last_data
from stages.shared.statistics.method_notes import MeasuredWeights


@dataclass(frozen=True)
class OneCheckpoint:
    """A checkpoint as the user named it."""

    name: str
    source: str

    @property
    def windows(self) -> tuple[int, ...]:
        """None: it has no seams between windows."""
        return ()

    def artefacts(self) -> list[Path]:
        """The checkpoint."""
        return [Path(self.source)]

    def facts(self) -> MeasuredWeights:
        """The page's note on it."""
        artefact = open_artefact(self.source, "checkpoint")
        trainings = read_checkpoint(artefact, optimiser=False).trainings
        return MeasuredWeights(
            name=self.name,
            source=self.source,
            data=last_data(trainings),
            digests={"checkpoint": artefact.manifest.digest},
            minutes=trainings[-1].minutes if trainings else None,
        )

    def trained_on(self) -> list[TrainingData]:
        """The data of all its trainings. Raises InputError if the checkpoint does not list them."""
        data = [each.data for each in read_checkpoint(self.source, optimiser=False).trainings]
        known = [each for each in data if each is not None]
        if not known or len(known) < len(data):
            raise InputError(f"{self.source} does not say what it was trained on.", "Leave --unseen away.")
        return known


def network_of(source: str) -> dict:
    """The config of the one checkpoint in a folder; empty if the folder is none."""
    if not (Path(source) / MANIFEST_NAME).is_file():
        return {}
    artefact = open_artefact(source)
    return read_checkpoint(artefact, optimiser=False).config if artefact.manifest.kind == "checkpoint" else {}
