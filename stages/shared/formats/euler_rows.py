"""Filled frames as rows of the file: Euler curves that leave one key and reach the next without a jump beside either.

A key's angles are the file's own and may be written in any of the equal forms (plus 360 degrees, or the other
triple). A curve that follows the key before may therefore arrive in another form than the key after has. Then the
curve without a jump that reaches that form is searched for (`stages.shared.formats.euler_path`). Where there is none,
the curve is followed from both keys and changes its form inside the gap, where it hurts least: near plus or minus 180
degrees, as the curves in the wild do. Such a jump is reported.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.bvh import BvhFile
from stages.shared.formats.bvh_rows import layout_of, values_of
from stages.shared.formats.euler_path import JUMP_DEGREES, path_between, through_lock

SAME_DEGREES = 1.0  # forms of an angle differ by far more, rounding by far less
_SHOWN = 4
_FRAMES_AT_ONCE = 2048  # about so many are computed together: bounds the memory of a long clip


@dataclass(frozen=True)
class EulerJump:
    """A channel that jumps although the rotation does not: the joint, and the frame into which it jumps."""

    joint: str
    frame: int


def rows_between_keys(
    bvh: BvhFile, skeleton: Skeleton, motion: Motion, keys: np.ndarray, key_values: np.ndarray
) -> tuple[np.ndarray, list[EulerJump]]:
    """Rows (T, C) of a filled motion in the file's unit, axes and channel orders, and the jumps that no curve avoids.

    Args:
        bvh: the file that the skeleton was read from.
        motion: T frames, the first of which is a key.
        keys: (K,) frames that are given, rising.
        key_values: (K, C) their rows as the file has them; they come back as they are.
    """
    columns = key_values.shape[1]
    layout = layout_of(bvh.joints)
    angles = [
        (bvh.joints[joint].name, axes, at)
        for axes, joints, places in layout.rotations
        for joint, at in zip(joints, places, strict=True)
        if axes
    ]

    def guide(frames: np.ndarray) -> np.ndarray:
        """Position channels of joints that stand still are taken from these: between keys, the keys' own values."""
        rows = np.full((len(frames), columns), np.nan)
        for column in layout.position_columns:
            rows[:, column] = np.interp(frames, keys, key_values[:, column])
        return rows

    out = np.empty((motion.frames, columns))
    out[keys] = key_values
    stops = [*keys[1:], motion.frames] if keys[-1] < motion.frames - 1 else [*keys[1:]]
    gaps = [(k, int(a), int(b)) for k, (a, b) in enumerate(zip(keys[: len(stops)], stops, strict=True)) if b - a > 1]
    starts = [(a, b, key_values[k]) for k, a, b in gaps]
    forward = _followed(bvh, skeleton, motion, guide, starts, 1)
    clashes: list[tuple[int, int, int, list[tuple[str, np.ndarray]]]] = []
    for (k, a, b), made in zip(gaps, forward, strict=True):
        out[a + 1 : b] = made[1 : b - a]
        if b < motion.frames:
            first, last = key_values[k], key_values[k + 1]
            differs = np.abs(made[-1] - last) > SAME_DEGREES
            joints = []
            for joint, axes, at in angles:
                if not differs[at].any():
                    continue
                curve = _without_jump(out[a + 1 : b, at], first[at], last[at], axes)
                if curve is None:
                    joints.append((joint, at))
                else:
                    out[a + 1 : b, at] = curve
            if joints:
                clashes.append((k, a, b, joints))
    backward = _followed(bvh, skeleton, motion, guide, [(b, a, key_values[k + 1]) for k, a, b, _ in clashes], -1)
    jumps: list[EulerJump] = []
    for (_, a, b, joints), made in zip(clashes, backward, strict=True):
        from_end = made[::-1][1:-1]
        for joint, at in joints:
            out[a + 1 : b, at] = _joined(out[a + 1 : b, at], from_end[:, at])
            steps = np.abs(np.diff(out[a : b + 1, at], axis=0)).max(axis=1)
            jumps += [EulerJump(joint, a + 1 + int(step)) for step in np.flatnonzero(steps > JUMP_DEGREES)]
    return out, jumps


def sentences_of_jumps(jumps: list[EulerJump], first: int) -> list[str]:
    """What the user should know of the jumps. first: the output's number of frame 0 of the jumps' frames."""
    if not jumps:
        return []
    shown = [f"{jump.joint} into frame {jump.frame + first}" for jump in jumps[:_SHOWN]]
    more = f" and {len(jumps) - _SHOWN} more" if len(jumps) > _SHOWN else ""
    return [
        f"Rotation channels jump by more than {JUMP_DEGREES:g} degrees where the rotation does not, since the keys "
        f"on both sides are written on different branches of the Euler angles: {', '.join(shown)}{more}. "
        "Apply an Euler filter to these channels in your animation program."
    ]


def _without_jump(angles: np.ndarray, first: np.ndarray, last: np.ndarray, axes: str) -> np.ndarray | None:
    """A joint's curve (M, n) in forms that reach the next key without a jump; None where there is no such curve."""
    if len(axes) == 1:
        return None
    found = through_lock(angles, first, last, axes)
    return path_between(angles, first, last) if found is None else found


def _followed(
    bvh: BvhFile,
    skeleton: Skeleton,
    motion: Motion,
    guide: Callable[[np.ndarray], np.ndarray],
    gaps: list[tuple[int, int, np.ndarray]],
    step: int,
) -> Iterator[np.ndarray]:
    """Rows of each gap from its start frame, whose row is given, to its end frame (both included), step by step."""
    runs = [np.arange(a, b + step, step) for a, b, _ in gaps]
    runs = [run[run < motion.frames] for run in runs]
    ends = np.cumsum([len(run) for run in runs])
    for _, some in groupby(range(len(gaps)), lambda gap: ends[gap] // _FRAMES_AT_ONCE):
        own = list(some)
        index = np.concatenate([runs[gap] for gap in own])
        near = guide(index)
        starts = np.cumsum([0, *(len(runs[gap]) for gap in own)])
        near[starts[:-1]] = [gaps[gap][2] for gap in own]
        yield from np.split(values_of(bvh, skeleton, motion.at(index), near), starts[1:-1])


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
