"""Which recordings are held out of the training: whole clips, or the end of the longest one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data_schemas.errors import InputError
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.statistics.windows import LEAST_FRAMES

SPAN = 121  # frames of a full window that is measured
_SHARE = 0.25  # of all frames, to hold out
_LEAST_SHARE, _MOST_SHARE = 0.1, 0.5


@dataclass(frozen=True)
class Part:
    """Frames [start, stop) of the clip with this index, to train on or held out."""

    clip: int
    start: int
    stop: int
    held_out: bool = False

    @property
    def frames(self) -> int:
        """How many frames it has."""
        return self.stop - self.start


def hold_out(lengths: Sequence[int], window: int, seed: int) -> list[Part]:
    """Divide clips into parts to train on and parts that are held out.

    Clips are drawn at random until a quarter of the frames is held out, of clips that take no more than half. Where
    such clips are too few, the end of the longest clip is held out, a training window after the part before it.

    Args:
        lengths: frames of the clips. window: frames of a window of the training.

    Raises: InputError if the clips are too short to hold anything out.
    """
    held = _held_clips(lengths, seed)
    if held:
        return [Part(index, 0, length, index in held) for index, length in enumerate(lengths)]
    longest = int(np.argmax(lengths))
    length = lengths[longest]
    begin = length - max(2 * LEAST_FRAMES, round(_SHARE * length))
    if begin - window < LEAST_FRAMES:
        needed = 3 * LEAST_FRAMES + window
        raise InputError(
            f"The longest recording has {length / MODEL_FPS:.1f} seconds, and {needed / MODEL_FPS:.1f} are needed to "
            "hold some of them out.",
            f"Give a longer one, or several of at least {2 * LEAST_FRAMES / MODEL_FPS:.1f} seconds.",
        )
    others = [Part(index, 0, frames) for index, frames in enumerate(lengths) if index != longest]
    return [*others, Part(longest, 0, begin - window), Part(longest, begin, length, held_out=True)]


def _held_clips(lengths: Sequence[int], seed: int) -> set[int]:
    """The clips to hold out; none where those that may be are too few."""
    total, held, frames = sum(lengths), set[int](), 0
    for index in np.random.default_rng(seed).permutation(len(lengths)):
        if frames >= _SHARE * total:
            break
        if lengths[index] >= LEAST_FRAMES and frames + lengths[index] <= _MOST_SHARE * total:
            held.add(int(index))
            frames += lengths[index]
    enough = frames >= _LEAST_SHARE * total and len(spans_of([lengths[index] for index in held])) > 1
    trained = max((length for index, length in enumerate(lengths) if index not in held), default=0)
    return held if enough and trained >= LEAST_FRAMES else set()


def spans_of(lengths: Sequence[int]) -> list[tuple[int, int, int]]:
    """The windows to measure in parts of these lengths: (number of the part, first frame, frames), without overlap.

    Windows have `SPAN` frames where the part has so many, else all of its frames; a single window is cut into two.
    """
    parts = [(number, length) for number, length in enumerate(lengths) if length >= LEAST_FRAMES]
    counts = [max(1, length // SPAN) for _, length in parts]
    if sum(counts) == 1 and parts[0][1] >= 2 * LEAST_FRAMES:
        counts = [2]
    found = []
    for (number, length), count in zip(parts, counts, strict=True):
        frames = min(SPAN, length // count)
        starts = np.linspace(0, length - frames, count) if count > 1 else [(length - frames) // 2]
        found += [(number, int(start), frames) for start in starts]
    return found
