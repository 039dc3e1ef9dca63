"""An edited motion: its frames, and which frames of the input they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_schemas.skeleton import Motion

NONE = -1  # in place of an input's frame: there is none


@dataclass(frozen=True)
class Edited:
    """A motion of T frames that was made from another one, or from two.

    Frames of the input are counted from 0. Where two inputs are joined, the frames of the second follow those of the
    first.

    motion:  the result.
    rows:    (T,) int64, the input's frame that this frame is, unchanged; NONE for another pose. A BVH's row of such a
             frame is copied byte for byte.
    like:    (T,) int64, the input's frame in whose form (signs of quaternions, whole turns of angles) this frame is
             written; NONE for the form of the frame before.
    placed:  (T,) bool, frames that differ from the frame `like` in the rotation and place of joint 0 alone.
    bridged: (T,) bool, frames that were filled in between others.
    notes:   what the user should know, one sentence each.
    """

    motion: Motion
    rows: np.ndarray
    like: np.ndarray
    placed: np.ndarray
    bridged: np.ndarray
    notes: tuple[str, ...] = ()

    @property
    def kept(self) -> dict[int, int]:
        """Frame -> the input's frame that it is, unchanged."""
        return {int(frame): int(self.rows[frame]) for frame in np.flatnonzero(self.rows != NONE)}

    @classmethod
    def of(
        cls,
        motion: Motion,
        rows: np.ndarray,
        like: np.ndarray | None = None,
        *,
        placed: np.ndarray | None = None,
        bridged: np.ndarray | None = None,
        notes: tuple[str, ...] = (),
    ) -> Edited:
        """With what is not given: `like` the rows, nothing placed, nothing bridged."""
        none = np.zeros(motion.frames, bool)
        return cls(
            motion,
            np.asarray(rows, np.int64),
            np.asarray(rows if like is None else like, np.int64),
            none if placed is None else placed,
            none if bridged is None else bridged,
            notes,
        )


def unchanged(motion: Motion) -> Edited:
    """A motion as it is."""
    return Edited.of(motion, np.arange(motion.frames))
