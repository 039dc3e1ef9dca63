"""Filled frames as rows of the file: Euler curves that leave one key and reach the next without a jump beside either.

A key's angles are the file's own and may be written in any of the equal forms (plus 360 degrees, or the other
triple). A curve that follows the key before may therefore arrive in another form than the key after has. Then the
curve is followed from both keys, and changes its form inside the gap, where it hurts least: near plus or minus 180
degrees, as the curves in the wild do.
"""

from __future__ import annotations

import numpy as np

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.bvh import BvhFile
from stages.shared.formats.bvh_rows import layout_of, values_of

SAME_DEGREES = 1.0  # forms of an angle differ by far more, rounding by far less


def rows_between_keys(
    bvh: BvhFile, skeleton: Skeleton, motion: Motion, keys: np.ndarray, key_values: np.ndarray
) -> np.ndarray:
    """Rows (T, C) of a filled motion in the file's unit, axes and channel orders.

    Args:
        bvh: the file that the skeleton was read from.
        motion: T frames, the first of which is a key.
        keys: (K,) frames that are given, rising.
        key_values: (K, C) their rows as the file has them; they come back as they are.
    """
    columns = key_values.shape[1]
    layout = layout_of(bvh.joints)
    angles = [at for _, _, joints in layout.rotations for at in joints if len(at)]
    # Position channels of joints that stand still are taken from these: between keys, the keys' own values.
    guide = np.full((motion.frames, columns), np.nan)
    frames = np.arange(motion.frames)
    for column in layout.position_columns:
        guide[:, column] = np.interp(frames, keys, key_values[:, column])
    out = np.empty((motion.frames, columns))
    out[keys] = key_values
    stops = [*keys[1:], motion.frames] if keys[-1] < motion.frames - 1 else [*keys[1:]]
    gaps = [(k, int(a), int(b)) for k, (a, b) in enumerate(zip(keys[: len(stops)], stops, strict=True)) if b - a > 1]
    forward = _followed(bvh, skeleton, motion, guide, [(a, b, key_values[k]) for k, a, b in gaps], 1)
    clashes: list[tuple[int, int, int, list[np.ndarray]]] = []
    for (k, a, b), made in zip(gaps, forward, strict=True):
        out[a + 1 : b] = made[1 : b - a]
        if b < motion.frames:
            differs = np.abs(made[-1] - key_values[k + 1]) > SAME_DEGREES
            joints = [at for at in angles if differs[at].any()]
            if joints:
                clashes.append((k, a, b, joints))
    backward = _followed(bvh, skeleton, motion, guide, [(b, a, key_values[k + 1]) for k, a, b, _ in clashes], -1)
    for (_, a, b, joints), made in zip(clashes, backward, strict=True):
        from_end = made[::-1][1:-1]
        for at in joints:
            here = out[a + 1 : b, at]
            out[a + 1 : b, at] = _joined(here, from_end[:, at])
    return out


def _followed(
    bvh: BvhFile,
    skeleton: Skeleton,
    motion: Motion,
    guide: np.ndarray,
    gaps: list[tuple[int, int, np.ndarray]],
    step: int,
) -> list[np.ndarray]:
    """Rows of each gap from its start frame, whose row is given, to its end frame (both included), step by step."""
    if not gaps:
        return []
    runs = [np.arange(a, b + step, step) for a, b, _ in gaps]
    runs = [run[run < motion.frames] for run in runs]
    index = np.concatenate(runs)
    near = guide[index].copy()
    starts = np.cumsum([0, *(len(run) for run in runs)])
    near[starts[:-1]] = [row for _, _, row in gaps]
    values = values_of(bvh, skeleton, motion.at(index), near)
    return np.split(values, starts[1:-1])


def _joined(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Two forms (M, n) of one joint's curve: the first up to a frame, the second after it.

    The change leaves at least one frame of each form beside its key where there are two, and comes where angles
    beyond half a turn are fewest; of equal places the middle.
    """
    frames = len(first)
    if frames < 2:
        return second
    beyond = [np.maximum(np.abs(form) - 180.0, 0.0).sum(-1) for form in (first, second)]
    changes = np.arange(1, frames)  # how many frames the first form keeps
    cost = np.cumsum(beyond[0])[changes - 1] + np.cumsum(beyond[1][::-1])[::-1][changes]
    off_centre = np.abs(changes - frames / 2)
    best = changes[np.lexsort((off_centre, np.round(cost, 6)))[0]]
    return np.concatenate([first[:best], second[best:]])
