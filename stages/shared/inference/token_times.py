"""The times at which the models sample a clip: 30 a second, and every key beside a gap at its exact time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.runs import runs_of

CLEARANCE = 0.5  # model frames; a 30 fps time nearer than this to a key is dropped
SPREAD = 48


@dataclass(frozen=True)
class Tokens:
    """Times of the N tokens of a clip.

    times:  (N,) float64, strictly rising, in model frames (30 a second) from the clip's frame 0.
    is_key: (N,) bool, True if a known frame has exactly this time.
    fps:    the clip's own rate.
    """

    times: np.ndarray
    is_key: np.ndarray
    fps: float

    def nearest(self, frames: np.ndarray) -> np.ndarray:
        """Index of the token nearest to each of the clip's frames; of a gap's frames, a token of that gap."""
        wanted = np.asarray(frames) * (MODEL_FPS / self.fps)
        after = np.clip(np.searchsorted(self.times, wanted), 1, max(len(self.times) - 1, 1))
        near = np.where(wanted - self.times[after - 1] < self.times[after] - wanted, after - 1, after)
        # A missing frame beside a key belongs to the gap, not to the key.
        inward = np.where(wanted > self.times[near], near + 1, near - 1).clip(0, len(self.times) - 1)
        return np.where(self.is_key[near], inward, near)

    def gaps(self) -> list[np.ndarray]:
        """Runs of tokens that are not keys, as arrays of indices."""
        return runs_of(~self.is_key)

    def around_gaps(self) -> np.ndarray:
        """(N,) bool, the tokens of gaps and the keys beside them."""
        free = ~self.is_key
        around = free.copy()
        around[1:] |= free[:-1]
        around[:-1] |= free[1:]
        return around

    def spread(self) -> np.ndarray:
        """Indices of some tokens, spread evenly over the clip: enough to find the bones of the points."""
        return np.unique(np.linspace(0, len(self.times) - 1, SPREAD).round().astype(np.int64))


def choose_tokens(keys: np.ndarray, frames: int, fps: float) -> Tokens:
    """Tokens of a clip whose known frames are `keys` (K,).

    Keys beside a missing frame, and the clip's first and last frame, are tokens at their exact times. Between them
    come the times of a 30 fps clock: in a gap unchanged, between known frames moved to the nearest known frame.
    """
    rate = MODEL_FPS / fps
    known = np.zeros(frames, bool)
    known[keys] = True
    beside = known.copy()
    beside[1:-1] &= ~(known[2:] & known[:-2])
    fixed = np.union1d(np.flatnonzero(beside), [0, frames - 1])
    fixed_times = fixed * rate
    clock = np.arange(0.0, (frames - 1) * rate + 1e-9)
    frame = np.rint(clock / rate).astype(np.int64).clip(0, frames - 1)
    before = np.floor(clock / rate + 1e-9).astype(np.int64).clip(0, frames - 1)
    among = known[before] & known[np.minimum(before + 1, frames - 1)]
    clock = np.where(among, frame * rate, clock)
    place = np.searchsorted(fixed_times, clock)
    left = np.abs(clock - fixed_times[np.maximum(place - 1, 0)])
    right = np.abs(clock - fixed_times[np.minimum(place, len(fixed) - 1)])
    free = np.minimum(left, right) >= CLEARANCE
    times, first = np.unique(np.concatenate([fixed_times, clock[free]]), return_index=True)
    is_key = np.concatenate([known[fixed], among[free]])[first]
    return Tokens(times, is_key, fps)
