"""The filled windows that evaluations keep, those of all methods together: scenes for the player, and spectra."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from data_schemas.errors import InputError
from data_schemas.fills import FilledBatch, FillsReader, kept_joints
from data_schemas.skeleton import Skeleton
from stages.report.drawings import Drawing, Heading, scene_of
from stages.shared.humanoid.stick_figure import stick_figure
from stages.shared.statistics.measurements import TRUTH
from stages.shared.statistics.tasks import INTERPOLATION, PREDICTION, TRANSITION

SHORT_WORDS = {INTERPOLATION: "keys every", TRANSITION: "gap of", PREDICTION: "prediction of"}


class _Chosen(NamedTuple):
    """A window: its batch, and its place in it."""

    batch: FilledBatch
    place: int


class FilledWindows:
    """Evaluations of the same windows. `artefacts` are open until `close`.

    Raises: InputError where one keeps no fills, measured other windows than the first, or measures a method again.
    """

    def __init__(self, paths: Sequence[Path]):
        self._readers: list[FillsReader] = []
        try:
            for path in paths:
                self._readers.append(FillsReader(path))
                self._check(self._readers[-1])
        except BaseException:
            self.close()
            raise
        first = self._readers[0]
        self.artefacts, self.batches, self.fps = [each.artefact for each in self._readers], first.batches, first.fps

    def _check(self, reader: FillsReader) -> None:
        first = self._readers[0]
        if [_windows_of(batch) for batch in reader.batches] != [_windows_of(batch) for batch in first.batches]:
            raise InputError(
                f"{reader.artefact.path} measured other windows than {first.artefact.path}.",
                "Give evaluations of the same motions, tasks, categories and max_windows.",
            )
        for each in self._readers[:-1]:
            for mine, theirs in zip(reader.batches, each.batches, strict=True):
                if twice := set(mine.methods) & set(theirs.methods) - {TRUTH}:
                    raise InputError(
                        f"{reader.artefact.path} measures {min(twice)} again.", "Give every method once."
                    )

    def skeleton(self, batch: FilledBatch) -> Skeleton:
        """The skeleton of a batch's windows."""
        return self._readers[0].skeleton(batch.skeleton)

    def methods(self, batch: FilledBatch) -> list[str]:
        """Those that filled a batch, the truth first."""
        made = [name for reader in self._readers for name in reader.batches[batch.number].methods]
        return list(dict.fromkeys([TRUTH, *made]))

    def poses(self, batch: FilledBatch, method: str, windows: slice = slice(None)) -> tuple[np.ndarray, np.ndarray]:
        """As `FillsReader.poses`, from the evaluation that measured the method."""
        reader = next(each for each in self._readers if method in each.batches[batch.number].methods)
        return reader.poses(reader.batches[batch.number], method, windows)

    def scenes(self, most: int) -> list[dict]:
        """At most `most` windows of each archive, task and interval as scenes of the player, spread evenly."""
        groups: dict[tuple[str, str, int], list[_Chosen]] = {}
        for batch in self.batches:
            members = groups.setdefault((batch.archive, batch.task, batch.interval), [])
            members += [_Chosen(batch, place) for place in range(len(batch.clips))]
        return [
            self._scene(members[pick])
            for members in groups.values()
            for pick in np.unique(np.linspace(0, len(members) - 1, min(most, len(members))).round().astype(int))
        ]

    def _scene(self, of: _Chosen) -> dict:
        batch, place = of
        start, frames = batch.starts[place], len(batch.known)
        clip = batch.clips[place].removeprefix(f"{batch.archive}.")
        heading = Heading(
            f"{batch.archive}, {task_title(batch.task, batch.interval)}",
            f"{clip}, frames {start} to {start + frames - 1}",
        )
        drawings = [self._drawing(of, method) for method in self.methods(batch)]
        return scene_of(heading, np.flatnonzero(batch.known), drawings) | {
            "task": batch.task,
            "interval": batch.interval,
        }

    def _drawing(self, of: _Chosen, method: str) -> Drawing:
        batch, place = of
        skeleton = self.skeleton(batch)
        joints = kept_joints(skeleton)
        positions, rotations = self.poses(batch, method, slice(place, place + 1))
        heads = np.zeros((len(batch.known), skeleton.joints, 3), np.float32)
        turns = np.zeros((len(batch.known), skeleton.joints, 4), np.float32)
        heads[:, joints], turns[:, joints] = positions[0], rotations[0]
        return Drawing(method, self.fps, stick_figure(skeleton, heads, turns))

    def close(self) -> None:
        """Close the files."""
        for reader in self._readers:
            reader.close()

    def __enter__(self) -> FilledWindows:
        return self

    def __exit__(self, *rest: object) -> None:
        self.close()


def task_title(task: str, interval: int) -> str:
    """What a window asks for, in few words."""
    return f"{SHORT_WORDS.get(task, task)} {interval}"


def tasks_of(fills: FilledWindows) -> Iterator[tuple[str, int, list[FilledBatch]]]:
    """The tasks and intervals in order, each with its batches of all archives."""
    for task, interval in dict.fromkeys((batch.task, batch.interval) for batch in fills.batches):
        yield task, interval, [b for b in fills.batches if (b.task, b.interval) == (task, interval)]


def _windows_of(batch: FilledBatch) -> tuple[object, ...]:
    return (batch.archive, batch.task, batch.interval, batch.skeleton, batch.clips, batch.starts, tuple(batch.known))
