"""A clip's own random draws, independent of the other measured clips."""

from __future__ import annotations

import numpy as np

from data_schemas.clips import ClipRow
from stages.shared.statistics.window_seeds import seed_words


def rng_of(seed: int, row: ClipRow) -> np.random.Generator:
    """The generator of a clip's cloud and of the changes to it."""
    return np.random.default_rng(seed_words(seed, row.clip))
