"""A channel that loses packets in bursts, and numbers of few bits."""

from __future__ import annotations

import numpy as np

_MOST = 1 / np.sqrt(2)  # the three smaller components of a unit quaternion are at most this
ROTATION_BITS = 10  # of each of three components; two more bits say which one is left out
ROTATION_BYTES = (3 * ROTATION_BITS + 2) / 8


def arrived(count: int, loss: float, burst: float, rng: np.random.Generator) -> np.ndarray:
    """(count,) bool, True for packets that arrive: Gilbert and Elliott's chain of two states.

    In the good state every packet arrives, in the bad state none. The chain starts in its stationary distribution, so
    that the share `loss` of packets is lost, in runs of `burst` packets in the mean.

    Args:
        loss: 0 to less than 1. burst: at least 1, and at least loss / (1 - loss).
    """
    if loss <= 0:
        return np.ones(count, bool)
    leave = 1 / burst  # from bad to good
    enter = min(1.0, leave * loss / (1 - loss))
    draws = rng.random(count + 1)
    good = np.empty(count, bool)
    state = draws[0] >= loss
    for packet in range(count):
        good[packet] = state
        state = draws[packet + 1] >= enter if state else draws[packet + 1] < leave
    return good


def quantised(values: np.ndarray, low: np.ndarray, high: np.ndarray, bits: int) -> np.ndarray:
    """Numbers (..., D) after the nearest of 2^bits levels from low (D,) to high (D,); those beyond are cut."""
    width = np.maximum(high - low, 1e-12)
    levels = 2**bits - 1
    return low + width * np.round(np.clip((values - low) / width, 0, 1) * levels) / levels


def quantised_rotations(rotations: np.ndarray) -> np.ndarray:
    """Unit quaternions (..., 4) after their three smaller components are sent with ten bits each."""
    largest = np.abs(rotations).argmax(-1)[..., None]
    sign = np.where(np.take_along_axis(rotations, largest, -1) < 0, -1.0, 1.0)
    sent = quantised(rotations * sign, np.full(4, -_MOST), np.full(4, _MOST), ROTATION_BITS)
    np.put_along_axis(sent, largest, 0.0, -1)
    rest = np.sqrt(np.maximum(1 - (sent**2).sum(-1, keepdims=True), 0))
    np.put_along_axis(sent, largest, rest, -1)
    return (sent / np.linalg.norm(sent, axis=-1, keepdims=True)).astype(rotations.dtype)


def held(values: np.ndarray, there: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Rows (N, ...) where they arrived, else the last one that did; `before` is held until the first arrives."""
    last = np.maximum.accumulate(np.where(there, np.arange(len(there)), -1))
    out = values[np.maximum(last, 0)].copy()
    out[last < 0] = before
    return out
