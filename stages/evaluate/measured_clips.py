"""The measured clips: chosen by split, read at 30 fps, cut into windows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from data_schemas.clip_filter import clips_where
from data_schemas.errors import InputError
from data_schemas.motion import ClipRow, MotionReader
from data_schemas.skeleton import Motion, Skeleton
from data_schemas.trainings import TrainingData
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.forward import positions_of
from stages.shared.kinematics.resampling import resample, resampled_frames
from stages.shared.statistics.archives import archive_of
from stages.shared.statistics.baselines import Poses
from stages.shared.statistics.categories import category_of
from stages.shared.statistics.windows import Task, Window, chosen_windows, clip_windows

BATCH_WINDOWS = 64
STATISTICS_CLIPS = 200  # clips for the training statistics of the lafan1 protocol, per skeleton
STATISTICS_WINDOW, STATISTICS_STRIDE = 50, 20  # as in that benchmark


@dataclass(frozen=True)
class WindowBatch:
    """Windows of one skeleton and one length, for one task."""

    skeleton_id: str
    skeleton: Skeleton
    windows: tuple[Window, ...]
    motions: tuple[Motion, ...]
    known: np.ndarray

    def poses(self) -> Poses:
        """The true windows."""
        return Poses.of(self.skeleton, list(self.motions))


class StatisticsWindows(NamedTuple):
    """Windows of 50 frames: joints' positions (N, 50, J, 3) metres, and the pelvis' rotations (N, 50, 4)."""

    positions: np.ndarray
    roots: np.ndarray


class MeasuredClips:
    """The clips of the wanted splits, by archive. Clips at 30 fps are kept in memory while an archive is measured.

    If the test split is wanted, an archive without training clips is measured on all its clips. With `trained_on`,
    the data of trainings, all clips of other archives are measured, in any split. With `categories`, names and
    patterns of sources, `archives` has these categories instead.
    """

    def __init__(
        self,
        reader: MotionReader,
        splits: Sequence[str],
        where: str | None = None,
        trained_on: Sequence[TrainingData] | None = None,
        categories: Mapping[str, str] | None = None,
    ):
        self._reader = reader
        self._cache: dict[str, Motion] = {}
        trained = {archive_of(row) for row in reader.clips if row.split == "train"}
        held_out = {archive_of(row) for row in reader.clips} - trained if "test" in splits else set()
        chosen = clips_where(reader.clips, where)
        rows = [row for row in chosen if row.split in splits or archive_of(row) in held_out]
        if trained_on is not None:
            rows = [row for row in chosen if not any(data.has_seen(row) for data in trained_on)]
            if not rows:
                raise InputError(
                    f"The weights were trained on clips of every archive in {reader.artefact.path}.",
                    "Give weights that were not, other recordings, or leave --unseen away.",
                )
        if not rows:
            found = ", ".join(f"{count} {split}" for split, count in Counter(r.split for r in chosen).items())
            raise InputError(
                f"{reader.artefact.path} has no clip of the split {' or '.join(splits)}.",
                f"It holds {found or 'no clips'}; name one of these with --splits.",
            )
        self.archives: dict[str, list[ClipRow]] = {}
        named = [(name, row) for row in rows if (name := category_of(row, categories or {})) is not None]
        for name, row in sorted(named, key=lambda pair: (pair[0], pair[1].clip)):
            self.archives.setdefault(name, []).append(row)

    def windows(self, archive: str, task: Task, limit: int) -> list[Window]:
        """The windows to measure; the same for every method."""
        lengths = {row.clip: resampled_frames(row.frames, row.fps, MODEL_FPS) for row in self.archives[archive]}
        return chosen_windows([clip_windows(clip, frames, task) for clip, frames in lengths.items()], limit)

    def batches(self, task: Task, windows: Sequence[Window]) -> Iterator[WindowBatch]:
        """The windows' true motions, batched by skeleton and length."""
        groups: dict[tuple[str, int], list[Window]] = {}
        for window in windows:
            groups.setdefault((self._reader.row(window.clip).skeleton, window.frames), []).append(window)
        for (skeleton_id, frames), members in groups.items():
            for first in range(0, len(members), BATCH_WINDOWS):
                part = tuple(members[first : first + BATCH_WINDOWS])
                yield WindowBatch(
                    skeleton_id,
                    self._reader.skeleton(skeleton_id),
                    part,
                    tuple(self._cut(window) for window in part),
                    task.known(frames),
                )

    def forget(self) -> None:
        """Drop the clips in memory."""
        self._cache.clear()

    def statistics_windows(self, skeleton_id: str) -> tuple[StatisticsWindows, bool]:
        """Windows for the training statistics of a skeleton, and whether they are of training clips.

        For a skeleton without a training clip, its measured clips are used.
        """
        own = [row for row in self._reader.clips if row.skeleton == skeleton_id]
        training = [row for row in own if row.split == "train"]
        rows = training or own
        picks = np.unique(np.linspace(0, len(rows) - 1, min(len(rows), STATISTICS_CLIPS)).round().astype(int))
        skeleton = self._reader.skeleton(skeleton_id)
        cut: list[np.ndarray] = []
        roots: list[np.ndarray] = []
        for pick in picks:
            motion = self._at_model_rate(rows[pick].clip)
            positions = positions_of(skeleton, motion)
            starts = range(0, len(positions) - STATISTICS_WINDOW, STATISTICS_STRIDE)
            cut += [positions[start : start + STATISTICS_WINDOW] for start in starts]
            roots += [motion.rotations[start : start + STATISTICS_WINDOW, skeleton.root] for start in starts]
        if not cut:
            raise InputError(
                f"{self._reader.artefact.path} has no clip of more than {STATISTICS_WINDOW} frames at 30 fps on the "
                f"skeleton {skeleton_id}, from which the lafan1 protocol takes its statistics.",
                "Use --protocol pumps, which needs none.",
            )
        return StatisticsWindows(np.stack(cut), np.stack(roots)), bool(training)

    def _cut(self, window: Window) -> Motion:
        if window.clip not in self._cache:
            self._cache[window.clip] = self._at_model_rate(window.clip)
        return self._cache[window.clip].at(window.span)

    def _at_model_rate(self, clip: str) -> Motion:
        return resample(self._reader.motion(clip), MODEL_FPS)
