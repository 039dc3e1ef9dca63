"""Seeds of what is drawn for one clip or window: the same whatever else is measured, and in which order."""

from __future__ import annotations

import zlib

import numpy as np


def seed_words(seed: int, clip: str, *numbers: int) -> list[int]:
    """Words that seed a generator: the user's seed, the clip's name, and further numbers, such as the first frame."""
    return [seed, zlib.crc32(clip.encode("utf-8", "surrogateescape")), *numbers]


def window_seed(seed: int, clip: str, start: int) -> int:
    """One seed for the window of a clip that begins at the frame `start`."""
    return int(np.random.SeedSequence(seed_words(seed, clip, start)).generate_state(1)[0])
