"""`pumps weights average`: several trainings that started from the same weights in, their mean out.

The mean of trainings from the same weights, with other windows or of other lengths, is better than each of them
(model soups, Wortsman et al. 2022): noise of the last steps averages out, and changes that all have in common remain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from data_schemas.errors import InputError
from data_schemas.trainings import Training, last_data, last_sentence
from stages.shared.contract import StageReport
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.weights.average.config import Config

# Trainings from the same weights were 0.09 to 0.11 of the weights' size apart, and their mean was good; other
# trainings of the same network are 1.4 apart, and their mean is useless.
_FAR = 0.4


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Write the mean of the checkpoints' weights, without an optimiser's state and without a log.

    Raises: InputError if they are not of one network and encoder, were trained on other data, or are too far apart to
        be averaged.
    """
    check_artefact(config, "checkpoint")
    progress.start("averaging", len(config.checkpoints))
    artefacts, kept = [], []
    for path in config.checkpoints:
        artefacts.append(open_artefact(path, "checkpoint"))
        kept.append(read_checkpoint(artefacts[-1], optimiser=False))
        progress.advance()
    for path, each in zip(config.checkpoints[1:], kept[1:], strict=True):
        if _network(each) != _network(kept[0]) or not _of_one_training(each, kept[0]):
            raise InputError(
                f"{path} is another network than {config.checkpoints[0]}, or of another encoder, or of other data.",
                "Average trainings that started from the same weights: `pumps train lms --initial`.",
            )
    mean = {name: _mean([each.weights[name] for each in kept]) for name in kept[0].weights}
    apart = max(_distance(each, mean) for each in kept)
    if apart > _FAR:
        raise InputError(
            f"These weights lie {apart:.2f} of their size from their mean, which is then no network that was learnt.",
            "Average trainings that started from the same weights: `pumps train lms --initial`.",
        )
    trainings = _trainings(kept)
    with write_artefact(
        config.output, "checkpoint", stage="weights-average", config=config, inputs=artefacts
    ) as draft:
        write_checkpoint(
            draft.folder,
            weights={name: np.asarray(value, np.float32) for name, value in mean.items()},
            config=kept[0].config,
            optimiser=None,
            log=[],
            card=_card(kept, trainings, sorted(draft.licences)),
            trainings=trainings,
        )
    return StageReport(
        output=config.output,
        lines=[f"The mean of {len(kept)} checkpoints, which lie up to {apart:.2f} of their size from it."],
        figures={"checkpoints": len(kept), "apart": apart},
    )


def _mean(arrays: Sequence[np.ndarray]) -> np.ndarray:
    return np.asarray(np.mean(arrays, axis=0, dtype=np.float64))


def _network(kept: Checkpoint) -> tuple[dict[str, Any], dict[str, tuple[int, ...]]]:
    """The properties that must be equal: the network's sizes, its encoder, and the arrays' shapes."""
    return kept.config, {name: array.shape for name, array in kept.weights.items()}


def _of_one_training(one: Checkpoint, other: Checkpoint) -> bool:
    """Whether one was trained on from the other, or the last trainings of both may have been on the same data."""
    if one.trainings and other.trainings:
        shorter = min(len(one.trainings), len(other.trainings))
        if one.trainings[:shorter] == other.trainings[:shorter]:
            return True
    mine, theirs = last_data(one.trainings), last_data(other.trainings)
    return mine is theirs or (mine is not None and theirs is not None and mine.agrees_with(theirs))


def _distance(kept: Checkpoint, mean: Mapping[str, np.ndarray]) -> float:
    """Distance of weights from their mean, as a share of the mean's size; infinite if they are not numbers."""
    apart = sum(float(np.square(kept.weights[name] - value).sum()) for name, value in mean.items())
    size = sum(float(np.square(value).sum()) for value in mean.values())
    share = float(np.sqrt(apart / max(size, np.finfo(float).tiny)))
    return share if np.isfinite(share) else float("inf")


def _trainings(kept: Sequence[Checkpoint]) -> list[Training]:
    """All trainings in the mean: shared ones once, then those of each."""
    every = [each.trainings for each in kept]
    shared = 0
    while all(len(own) > shared and own[shared] == every[0][shared] for own in every):
        shared += 1
    return [*every[0][:shared], *(training for own in every for training in own[shared:])]


def _card(kept: Sequence[Checkpoint], trainings: Sequence[Training], licences: Sequence[str]) -> str:
    count = sum(value.size for value in kept[0].weights.values())
    lines = [
        "# weights average: weights of pumps",
        "",
        f"- The mean of {len(kept)} checkpoints' weights (Wortsman et al. 2022).",
        f"- Trained on: {last_sentence(kept[0].trainings) or 'not stated'}.",
        "- Licences of the data, which the weights carry, apart from the code's Apache-2.0:",
        *[f"  - {licence}" for licence in licences or ["none stated"]],
        f"- Size: {count:,} parameters.",
        *[f"- Of a training of {each.steps} steps in {each.minutes} minutes." for each in trainings],
        "",
    ]
    return "\n".join(lines)
