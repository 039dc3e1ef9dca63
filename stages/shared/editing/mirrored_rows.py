"""The rows of a BVH in a mirror: numbers change their columns and signs, and keep their digits."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from data_schemas.skeleton import Skeleton
from stages.shared.editing.mirror import Mirror
from stages.shared.formats.bvh import BvhFile
from stages.shared.formats.bvh_header import POSITION_CHANNELS
from stages.shared.humanoid.reference_pose import turn_to_y_up

_BLANKS = re.compile(rb"(\s+)")


@dataclass(frozen=True)
class MirroredColumns:
    """Where the numbers of a mirrored row come from.

    source: (C,) the column whose number, with its digits, becomes this column's; -1 if it has to be computed.
    sign:   (C,) 1 or -1, by which it is multiplied.
    """

    source: np.ndarray
    sign: np.ndarray


def mirrored_columns(bvh: BvhFile, skeleton: Skeleton, mirror: Mirror, tracked: set[int]) -> MirroredColumns:
    """The columns of a mirrored row.

    Euler angles of a joint come from its partner's if both have the same channels, and if the reflections of the two
    frames that it turns between are one and the same change of signs. The angle about an axis whose sign is changed
    stays, and the two others change theirs.

    Args:
        tracked: joints whose place varies, and their partners. The places of others stay as they are.
    """
    columns = sum(len(joint.channels) for joint in bvh.joints)
    source, sign = np.full(columns, -1), np.ones(columns)
    turn = turn_to_y_up(skeleton.up_axis)
    up = np.eye(3) if turn is None else turn.as_matrix()
    world = up.T @ mirror.world @ up  # in the file's axes
    for index, joint in enumerate(bvh.joints):
        partner = int(mirror.partner[index])
        theirs = bvh.joints[partner]
        above = world if index == 0 else mirror.frames[int(skeleton.parents[index])]
        signs = _signs_of(above)
        turns_alike = signs is not None and np.array_equal(np.diag(signs), mirror.frames[index])
        for at, channel in enumerate(joint.channels):
            column = joint.first_channel + at
            axis = "XYZ".index(channel[0])
            is_place = channel in POSITION_CHANNELS
            if is_place and index > 0 and index not in tracked:
                source[column] = column
            elif signs is not None and joint.channels == theirs.channels and (is_place or turns_alike):
                source[column] = theirs.first_channel + at
                sign[column] = signs[axis] if is_place else -signs[axis]
    if skeleton.root > 0 and (source[: len(bvh.joints[0].channels)] >= 0).all():
        _leave_off_centre_places(bvh, skeleton, mirror, source)
    return MirroredColumns(source, sign)


def _signs_of(reflection: np.ndarray) -> np.ndarray | None:
    """The diagonal of a reflection that only changes signs; None for another one."""
    signs = np.round(np.diag(reflection))
    return signs if np.allclose(np.diag(signs), reflection, atol=1e-9) and np.abs(signs).min() == 1 else None


def _leave_off_centre_places(bvh: BvhFile, skeleton: Skeleton, mirror: Mirror, source: np.ndarray) -> None:
    """Joint 0's place is computed where the way from it to the pelvis is not its own mirror image."""
    joint = skeleton.root
    while joint > 0:
        parent = int(skeleton.parents[joint])
        offset = skeleton.offsets[joint]
        if np.abs(mirror.frames[parent] @ offset - offset).max() > 1e-3:
            for at, channel in enumerate(bvh.joints[0].channels):
                if channel in POSITION_CHANNELS:
                    source[at] = -1
        joint = parent


def mirrored_text(bvh: BvhFile, columns: MirroredColumns, values: np.ndarray) -> BvhFile:
    """The file with mirrored rows, of which the numbers that only move keep their digits.

    Args:
        values: (T, C) computed rows, for the columns without a source.
    """
    moved = np.flatnonzero(columns.source >= 0)
    out = values.copy()
    out[:, moved] = bvh.values[:, columns.source[moved]] * columns.sign[moved]
    return replace(bvh, values=out, rows=[_row(row, columns, made) for row, made in zip(bvh.rows, out, strict=True)])


def _row(row: bytes, columns: MirroredColumns, made: np.ndarray) -> bytes:
    parts = _BLANKS.split(row)
    places = [at for at in range(0, len(parts), 2) if parts[at]]
    numbers = [parts[at] for at in places]
    for column, at in enumerate(places):
        source = int(columns.source[column])
        if source < 0:
            parts[at] = b"%.6f" % (round(float(made[column]), 6) + 0.0)
        else:
            parts[at] = numbers[source] if columns.sign[column] > 0 else _negated(numbers[source])
    return b"".join(parts)


def _negated(number: bytes) -> bytes:
    """The number with the other sign; zeros, and words that are no numbers, stay."""
    if not number.strip(b"+-0.eE"):
        return number
    return number[1:] if number.startswith(b"-") else b"-" + number.removeprefix(b"+")
