"""Sampling the curves of glTF animations at any times: LINEAR, STEP and CUBICSPLINE, by glTF's specification."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_schemas.errors import InputError
from stages.shared.kinematics.rotations import slerp

_HAIR_S = 1e-4


@dataclass(frozen=True)
class Track:
    """One curve. times: (K,) seconds, ascending; values: (K, width), or (3 K, width) for CUBICSPLINE.

    width: 3 for translations and scales, 4 for rotations xyzw. where: the curve's name in error messages.
    """

    times: np.ndarray
    values: np.ndarray
    kind: str
    width: int
    where: str

    def check(self) -> None:
        """Raises InputError if times and values do not form a curve."""
        per_key = 3 if self.kind == "CUBICSPLINE" else 1
        if self.kind not in ("LINEAR", "STEP", "CUBICSPLINE"):
            raise InputError(f"{self.where} has the interpolation {self.kind[:40]}, which glTF does not define.")
        if self.values.shape != (per_key * len(self.times), self.width):
            raise InputError(f"{self.where} has {len(self.times)} times but values of the shape {self.values.shape}.")
        if (np.diff(self.times) < 0).any():
            raise InputError(f"{self.where} has times that do not increase.")
        if self.width == 4 and (np.linalg.norm(self._keys(), axis=1) < 0.1).any():
            raise InputError(f"{self.where} has a quaternion of zero length.")

    def _keys(self) -> np.ndarray:
        return self.values[1::3] if self.kind == "CUBICSPLINE" else self.values


def sampled(track: Track, times: np.ndarray) -> np.ndarray:
    """(T, width) values at `times`; constant before the first key and after the last."""
    keys = track._keys()
    # Times in files are rounded: a step that lies less than `_HAIR_S` ahead counts as reached.
    after = np.searchsorted(track.times, times + (_HAIR_S if track.kind == "STEP" else 0.0), side="right")
    left = np.clip(after - 1, 0, len(keys) - 1)
    right = np.clip(after, 0, len(keys) - 1)
    span = track.times[right] - track.times[left]
    share = np.where(span > 0, (times - track.times[left]) / np.where(span > 0, span, 1.0), 0.0)[:, None]
    share = np.clip(share, 0.0, 1.0)
    if track.kind == "STEP":
        values = keys[left]
    elif track.kind == "CUBICSPLINE":
        into, out = track.values[0::3], track.values[2::3]
        square, cube = share**2, share**3
        values = (
            (2 * cube - 3 * square + 1) * keys[left] + span[:, None] * (cube - 2 * square + share) * out[left]
            + (3 * square - 2 * cube) * keys[right] + span[:, None] * (cube - square) * into[right]
        )  # fmt: skip
    elif track.width == 4:
        keys = keys / np.linalg.norm(keys, axis=1, keepdims=True)
        values = slerp(keys[left], keys[right], share)
    else:
        values = keys[left] + share * (keys[right] - keys[left])
    if track.width == 4:
        values = np.where(np.linalg.norm(values, axis=1, keepdims=True) > 1e-6, values, keys[left])
        values = values / np.linalg.norm(values, axis=1, keepdims=True)
    return values
