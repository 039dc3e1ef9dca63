"""Rows of a BVH of which some columns are given: which columns, their values, and the curves between them."""

from __future__ import annotations

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.bvh import BvhFile
from stages.shared.formats.bvh_rows import layout_of
from stages.shared.formats.euler_rows import EulerJump, rows_between_keys
from stages.shared.inference.constraints.known_parts import KnownParts
from stages.shared.inference.constraints.rig_parts import placing_joints


def columns_given(bvh: BvhFile, parts: KnownParts, skeleton: Skeleton) -> np.ndarray:
    """(T, C) bool, the columns of what is given of T frames.

    Position channels of the pelvis and of joints above it belong to the place; those of other joints to the joint.
    """
    layout = layout_of(bvh.joints)
    out = np.zeros((len(parts.position), bvh.values.shape[1]), bool)
    for _, joints, columns in layout.rotations:
        for joint, at in zip(joints, columns, strict=True):
            out[:, at] = parts.joints[:, joint, None]
    placing = placing_joints(skeleton)
    for joint, column in zip(layout.position_joints, layout.position_columns, strict=True):
        out[:, column] = parts.position if placing[joint] else parts.joints[:, joint]
    return out


def values_given(bvh: BvhFile, parts: KnownParts, skeleton: Skeleton) -> np.ndarray:
    """(T, C) the given values; what is not given lies on lines between what is, column by column, and is not read.

    Raises: InputError for a row that is given in part and is no row of numbers.
    """
    given = columns_given(bvh, parts, skeleton)
    bad = np.flatnonzero((given & ~np.isfinite(bvh.values)).any(axis=1))
    if len(bad):
        raise InputError(
            f"{bvh.name}: row {bad[0]}, of which parts are kept, does not hold {bvh.values.shape[1]} numbers.",
            "Mend the row or leave it out.",
        )
    frames = np.arange(len(given))
    out = np.empty(given.shape)
    for column in range(given.shape[1]):
        own = np.flatnonzero(given[:, column])
        out[:, column] = np.interp(frames, own, bvh.values[own, column])
    return out


def rows_between_parts(
    bvh: BvhFile, skeleton: Skeleton, motion: Motion, given: np.ndarray, values: np.ndarray
) -> tuple[np.ndarray, list[EulerJump]]:
    """As `rows_between_keys`, where each column has keys of its own.

    Args:
        motion: T frames, the first of which is given as a whole.
        given: (T, C) bool. values: (T or fewer, C) the given values, as the file has them.
    """
    out = np.zeros(given.shape)
    jumps: dict[tuple[str, int], EulerJump] = {}
    own_columns = {
        joint.name: {joint.first_channel + channel for channel in range(len(joint.channels))} for joint in bvh.joints
    }
    kinds: dict[bytes, list[int]] = {}
    for column in range(given.shape[1]):
        kinds.setdefault(given[:, column].tobytes(), []).append(column)
    for columns in kinds.values():
        keys = np.flatnonzero(given[:, columns[0]])
        made, found = rows_between_keys(bvh, skeleton, motion, keys, values[keys])
        out[:, columns] = made[:, columns]
        for jump in found:
            if own_columns[jump.joint] & set(columns):
                jumps[jump.joint, jump.frame] = jump
    return out, sorted(jumps.values(), key=lambda jump: jump.frame)
