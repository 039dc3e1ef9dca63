"""Windows of clips with noise: the same for every method, since the noise depends on seed, clip and start alone."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from data_schemas.clips import ClipRow
from data_schemas.errors import InputError, UsageError
from data_schemas.motion import MotionReader
from data_schemas.skeleton import Motion, Skeleton
from stages.measure.denoise.config import Config
from stages.shared.inference.denoising import motion_from, positions_in
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.forward_numpy import local_rotations_of
from stages.shared.kinematics.resampling import resample, resampled_frames
from stages.shared.pose_tasks.noise import NOISES
from stages.shared.statistics.category_tables import category_of, patterns_of

CLEAN = "clean"


@dataclass(frozen=True)
class NoisyWindow:
    """A window of T frames at 30 a second, true and with noise on the joints of its body and on its pelvis."""

    row: ClipRow
    category: str
    skeleton: Skeleton
    true: Motion
    noisy: Motion


def noisy_windows(reader: MotionReader, config: Config, splits: Sequence[str]) -> Iterator[NoisyWindow]:
    """Windows that do not overlap, in the order of categories and clips.

    Raises: UsageError for an unknown noise, InputError if no clip is long enough.
    """
    if config.noise not in (CLEAN, *NOISES):
        raise UsageError(f"There is no noise {config.noise!r}.", f"Take one of {CLEAN}, {', '.join(NOISES)}.")
    patterns = patterns_of(config.category)
    by_category: dict[str, list[tuple[ClipRow, int]]] = {}
    for row in sorted(reader.clips, key=lambda row: row.clip):
        frames = resampled_frames(row.frames, row.fps, MODEL_FPS)
        category = category_of(row, patterns)
        if row.split in splits and category is not None:
            starts = range(0, frames - config.window + 1, config.window)
            by_category.setdefault(category, []).extend((row, start) for start in starts)
    if not any(by_category.values()):
        raise InputError(
            f"{config.motion} has no clip of {config.window} frames in {', '.join(splits)}.",
            "Name another split with --splits, or patterns that match with --category.",
        )
    for category, found in sorted(by_category.items()):
        if config.max_windows and len(found) > config.max_windows:
            found = [found[i] for i in np.linspace(0, len(found) - 1, config.max_windows).round().astype(int)]
        for clip in dict.fromkeys(row.clip for row, _ in found):
            row = reader.row(clip)
            skeleton, motion = reader.skeleton(row.skeleton), resample(reader.motion(clip), MODEL_FPS)
            for start in (start for each, start in found if each.clip == clip):
                true = motion.at(slice(start, start + config.window))
                rng = np.random.default_rng([config.seed, zlib.crc32(clip.encode("utf-8", "surrogateescape")), start])
                yield NoisyWindow(row, category, skeleton, true, with_noise(skeleton, true, config.noise, rng))


def with_noise(skeleton: Skeleton, motion: Motion, noise: str, rng: np.random.Generator) -> Motion:
    """A motion with a preset's noise on the pelvis' position and on the rotations of the body's joints."""
    if noise == CLEAN:
        return motion
    local, positions = local_rotations_of(skeleton, motion), positions_in(motion)
    body = np.flatnonzero(skeleton.groups >= 0)
    tracked = np.flatnonzero(motion.track_joints == skeleton.root)
    first = 3 + 3 * int(tracked[0]) if len(tracked) else 0
    at = slice(first, first + 3)
    positions[:, at], local[:, body], _ = NOISES[noise](positions[:, at], local[:, body], rng)
    return replace(motion_from(skeleton, motion, local, positions), fps=motion.fps)
