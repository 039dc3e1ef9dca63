"""Networks made small enough to hand on: without the optimiser's state and without places on the disk."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from data_schemas.manifest import Artefact

UNKNOWN = "unknown"  # as `pumps ingest` has it where no licence was stated
LOGGED = ("step", "split", "loss", "score", "rec_mm", "moving_mm")


def read_to_pack(source: Artefact, known: Sequence[str] = ()) -> Checkpoint:
    """A checkpoint whose card gives only the names of the training's folders, without their paths, and the known
    licences in place of one that was unknown."""
    found = read_checkpoint(source, optimiser=False)
    if known:
        lines = "\n".join(f"  - {licence}" for licence in known)
        found = replace(found, card=found.card.replace(f"  - {UNKNOWN}", lines))
    for place, name in sorted(_places(source.manifest.config), key=lambda each: -len(each[0])):
        found = replace(found, card=found.card.replace(place, name))
    return found


def write_packed(
    path: Path,
    kept: Checkpoint,
    source: Artefact,
    *,
    stage: str,
    licences: Iterable[str],
    half: bool = True,
    logged: Sequence[str] | None = LOGGED,
) -> Artefact:
    """Write a checkpoint without its optimiser's state.

    Args:
        kept: what to write. source: the artefact that it is from, or that its training started from.
        licences: of the data. half: store the weights in half precision.
        logged: the log's columns to keep; None: all.
    """
    width = np.float16 if half else np.float32
    settings = {"half": half, "trained": _without_places(source.manifest.config), "digest": source.manifest.digest}
    with write_artefact(path, "checkpoint", stage=stage, config=settings, licences=licences) as draft:
        write_checkpoint(
            draft.folder,
            weights={name: value.astype(width) for name, value in kept.weights.items()},
            config=kept.config,
            optimiser=None,
            log=[{name: row[name] for name in logged or row if name in row} for row in kept.log],
            card=kept.card,
            trainings=kept.trainings,
        )
    return open_artefact(path, "checkpoint")


def licences_of(source: Artefact, known: Sequence[str]) -> list[str]:
    """The licences of the sources; with `known`, those in place of the one that was unknown."""
    stated = set(source.manifest.licences)
    if known and UNKNOWN in stated:
        stated = (stated - {UNKNOWN}) | set(known)
    return sorted(stated)


def _places(settings: Any) -> Iterator[tuple[str, str]]:
    """Every absolute path among settings, and its last part."""
    if isinstance(settings, dict | list):
        for value in settings.values() if isinstance(settings, dict) else settings:
            yield from _places(value)
    elif isinstance(settings, str):
        for kind in (PurePosixPath, PureWindowsPath):
            if kind(settings).is_absolute():
                yield settings, kind(settings).name


def _without_places(settings: Any) -> Any:
    """The settings with each absolute path replaced by its last part."""
    if isinstance(settings, dict):
        return {name: _without_places(value) for name, value in settings.items()}
    if isinstance(settings, list):
        return [_without_places(value) for value in settings]
    return next((name for _, name in _places(settings)), settings)
