"""The tasks' windows and which of their frames are known."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from data_schemas.clips import ClipRow
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.statistics.archives import archive_of
from stages.shared.statistics.tasks import INTERPOLATION, PREDICTION, TRANSITION

LEAST_FRAMES = 46  # a clip shorter than this is not measured
CONTEXT = 15  # known frames on each side of a transition
LAFAN1_CONTEXT = (10, 1)  # that benchmark's known frames before and after the gap
LAFAN1_SPAN, LAFAN1_STRIDE = 65, 40  # its windows: so long that every gap fits in one, so many frames apart
GOLDEN_SHARE = 0.6180339887498949


@dataclass(frozen=True)
class Task:
    """One thing to measure. `interval`: frames between keys, or missing frames, or frames to predict."""

    name: str
    interval: int
    window: int  # frames of a window of interpolation and prediction
    context: tuple[int, int] = (CONTEXT, CONTEXT)
    stride: int = (
        0  # a transition's windows begin every so many frames, as LaFAN1's; 0 for windows that do not overlap
    )

    @property
    def frames(self) -> int:
        """Frames in a full window."""
        return self.interval + sum(self.context) if self.name == TRANSITION else self.window

    def frames_in(self, clip_frames: int) -> int:
        """Frames of a window in a clip of this length; 0 where the clip is too short to be measured.

        A short clip is measured at its own length, except in transitions, since the gap would shrink.
        """
        if clip_frames >= self.frames:
            return self.frames
        if self.name == TRANSITION or clip_frames < LEAST_FRAMES or clip_frames <= self.interval + 1:
            return 0
        return clip_frames

    def known(self, frames: int) -> np.ndarray:
        """(frames,) bool, True where the frame is given."""
        known = np.zeros(frames, bool)
        if self.name == INTERPOLATION:
            known[:: self.interval] = True
            known[-1] = True
        elif self.name == TRANSITION:
            known[: self.context[0]] = True
            known[frames - self.context[1] :] = True
        else:
            known[: frames - self.interval] = True
        return known


@dataclass(frozen=True)
class Window:
    """Frames [start, start + frames) of a clip at 30 fps."""

    clip: str
    start: int
    frames: int

    @property
    def span(self) -> slice:
        """Its frames in the clip."""
        return slice(self.start, self.start + self.frames)


def tasks_of(
    intervals: Sequence[int], transitions: Sequence[int], predictions: Sequence[int], window: int
) -> list[Task]:
    """Interpolations, then transitions, then predictions."""
    named = ((INTERPOLATION, intervals), (TRANSITION, transitions), (PREDICTION, predictions))
    return [Task(name, each, window) for name, numbers in named for each in numbers]


def planned_windows(
    clips: Sequence[ClipRow], splits: Sequence[str], tasks: Sequence[Task], limit: int, seed: int | None = None
) -> Iterator[tuple[str, Task, Window]]:
    """At most `limit` windows for each archive and task, of the clips of some splits.

    Args:
        seed: with one, each task has the clips in a random order of its own, so that it gets other windows.
    """
    archives: dict[str, list[ClipRow]] = {}
    for row in clips:
        if row.split in splits:
            archives.setdefault(archive_of(row), []).append(row)
    for archive, rows in sorted(archives.items()):
        for number, task in enumerate(tasks):
            ordered = rows
            if seed is not None:
                ordered = [rows[at] for at in np.random.default_rng([seed, number]).permutation(len(rows))]
            windows = [clip_windows(row.clip, int(row.seconds * MODEL_FPS), task) for row in ordered]
            for window in chosen_windows(windows, limit):
                yield archive, task, window


def clip_windows(clip: str, clip_frames: int, task: Task) -> list[Window]:
    """All windows that fit without overlap, spread evenly from the clip's first frame to its last.

    With a stride: those that begin at its multiples and end, with LaFAN1's length, before the clip's last frame, as
    in that benchmark.
    """
    frames = task.frames_in(clip_frames)
    if not frames:
        return []
    if task.stride:
        last = clip_frames - max(frames, LAFAN1_SPAN)
        return [Window(clip, start, frames) for start in range(0, last, task.stride)]
    starts = np.linspace(0, clip_frames - frames, max(1, clip_frames // frames))
    if len(starts) == 1:
        starts = np.array([(clip_frames - frames) // 2])
    return [Window(clip, int(start), frames) for start in starts]


def chosen_windows(by_clip: Sequence[Sequence[Window]], limit: int) -> list[Window]:
    """At most `limit` windows (0: all), spread evenly over clips, and over each clip's length.

    The choice depends only on the lists, so every method and every run measures the same windows.
    """
    clips = [windows for windows in by_clip if windows]
    if not limit or sum(map(len, clips)) <= limit:
        return [window for windows in clips for window in windows]
    if len(clips) > limit:
        clips = [clips[(2 * i + 1) * len(clips) // (2 * limit)] for i in range(limit)]
    chosen: list[Window] = []
    for number, (windows, quota) in enumerate(zip(clips, _quotas([len(w) for w in clips], limit), strict=True)):
        # If a clip gives one window of many, its position differs from clip to clip, since the beginnings of clips
        # are alike.
        shift = (number * GOLDEN_SHARE) % 1
        picks = {int((i + shift) * len(windows) / quota) for i in range(quota)}
        chosen += [windows[i] for i in sorted(picks)]
    return chosen


def _quotas(lengths: Sequence[int], limit: int) -> list[int]:
    """Windows to take from each clip: one round after another, as long as the clip has any left."""
    quotas = [0] * len(lengths)
    while limit:
        for clip, length in enumerate(lengths):
            if limit and quotas[clip] < length:
                quotas[clip] += 1
                limit -= 1
    return quotas
