"""A description of an evaluation's methods: facts in the manifest's summary, with one sentence for each."""

from __future__ import annotations

from typing import NamedTuple

from pydantic import BaseModel, ConfigDict

from data_schemas.trainings import TrainingData
from stages.shared.statistics.measurements import RECONSTRUCTED, REFINED, TRUE_CLOUD


class MeasuredWeights(BaseModel):
    """Weights that were measured.

    name:    the method's name.
    source:  folder or name of the weights.
    data:    the data of their last training.
    digests: SHA-256 of each of their parts: of the checkpoints' content, and of the file of their confidence.
    minutes: of the last training of each of their networks, added up; None where one is not known.
    native:  whether any of their trainings used clips of the measured archives; None where it is not known.
    """

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)

    name: str
    source: str
    data: TrainingData | None = None
    digests: dict[str, str] = {}
    minutes: float | None = None
    native: bool | None = None


class MethodFacts(BaseModel):
    """Notes on an evaluation's methods.

    weights:   the weights that were measured.
    breakdown: whether parts of the filling were measured on true clouds.
    refined:   whether fills were also refined by motion concepts.
    borrowed_statistics: ids of skeletons without a training clip for the LaFAN1 statistics.
    """

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)

    weights: list[MeasuredWeights] = []
    breakdown: bool = False
    refined: bool = False
    borrowed_statistics: list[str] = []


class Words(NamedTuple):
    """A part of a sentence; a name is set as code."""

    text: str
    is_name: bool = False


Sentence = tuple[Words, ...]


def method_notes(facts: MethodFacts) -> list[Sentence]:
    """One sentence for each method that needs one."""
    notes = [_weights_note(each) for each in facts.weights]
    if facts.refined and facts.weights:
        notes.append(
            (Words(f"…{REFINED}", True), Words(": the same fill, refined by motion concepts; its keys stay."))
        )
    if facts.breakdown and facts.weights:
        lost = "what is lost without the synthesiser"
        solved = f": the solve on the autoencoder's reconstruction of the true cloud, nothing masked: {lost}."
        notes.append((Words(f"…{RECONSTRUCTED}", True), Words(solved)))
    if facts.breakdown:
        solved = ": the solve on the true cloud, no network: what the solve alone loses."
        notes.append((Words(TRUE_CLOUD, True), Words(solved)))
    return notes


def _weights_note(weights: MeasuredWeights) -> Sentence:
    data = weights.data.sentence if weights.data else "no one says"
    return Words(weights.name, True), Words(": weights "), Words(weights.source, True), Words(f", trained on {data}.")


def markdown_of(sentence: Sentence) -> str:
    """The sentence with its names in backquotes."""
    return "".join(f"`{part.text}`" if part.is_name else part.text for part in sentence)


def borrowed_note(facts: MethodFacts) -> str:
    """One sentence on statistics that do not come from training clips; "" if all do."""
    if not facts.borrowed_statistics:
        return ""
    return (
        f"No training clip is on the skeletons {', '.join(facts.borrowed_statistics)}: the LaFAN1 statistics are "
        "those of their measured clips."
    )
