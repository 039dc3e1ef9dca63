"""The columns of a BVH's rows: their meaning, rows to rotations, and poses back to rows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats import euler
from stages.shared.formats.bvh import BvhFile
from stages.shared.formats.bvh_header import POSITION_CHANNELS, BvhJoint
from stages.shared.humanoid.reference_pose import turn_to_y_up
from stages.shared.kinematics.forward_numpy import local_rotations
from stages.shared.kinematics.rotations import multiply

_LONG_FRAMES = 1000


@dataclass(frozen=True)
class Layout:
    """The meaning of a row's columns.

    rotations: for each channel order in the file (such as "ZXY"): joints (n,) and columns (n, len(order)).
    position_joints, position_axes, position_columns: (M,) each, one entry a position channel.
    """

    rotations: tuple[tuple[str, np.ndarray, np.ndarray], ...]
    position_joints: np.ndarray
    position_axes: np.ndarray
    position_columns: np.ndarray

    def positions_of(self, joint: int) -> tuple[np.ndarray, np.ndarray]:
        """Axes (0 to 2) and columns of a joint's position channels."""
        mine = self.position_joints == joint
        return self.position_axes[mine], self.position_columns[mine]


@lru_cache(maxsize=64)
def layout_of(joints: tuple[BvhJoint, ...]) -> Layout:
    """The layout of the rows that belong to these joints."""
    orders: dict[str, tuple[list[int], list[list[int]]]] = {}
    positions: list[tuple[int, int, int]] = []
    for index, joint in enumerate(joints):
        turning = [(c, joint.first_channel + i) for i, c in enumerate(joint.channels) if c not in POSITION_CHANNELS]
        order = "".join(channel[0] for channel, _ in turning)
        indices, columns = orders.setdefault(order, ([], []))
        indices.append(index)
        columns.append([column for _, column in turning])
        for i, channel in enumerate(joint.channels):
            if channel in POSITION_CHANNELS:
                positions.append((index, POSITION_CHANNELS.index(channel), joint.first_channel + i))
    found = np.array(positions, np.int64).reshape(-1, 3)
    return Layout(
        tuple((order, np.array(js), np.array(cs, np.int64)) for order, (js, cs) in orders.items()),
        *(found[:, i] for i in range(3)),
    )


class RowRotations:
    """Rotations in the parents' frames of rows (T, C), computed for the rows that are asked for.

    `rotations[frames]`, with a slice or an index array, is (N, J, 4) float64. Its memory layout is (4, J, N), time
    last, since all operations on rotations run along time.
    """

    def __init__(self, joints: tuple[BvhJoint, ...], values: np.ndarray):
        self._values, self._alike = values, _alike(joints, values)
        self.shape = (len(values), len(joints), 4)

    def __len__(self) -> int:
        return len(self._values)

    def __getitem__(self, frames: slice | np.ndarray) -> np.ndarray:
        channels = np.ascontiguousarray(self._values[frames].T)
        parts = np.empty((4, self.shape[1], channels.shape[1]))
        for order, indices, columns, turning in self._alike:
            parts[:, indices] = euler.quaternion_parts(channels[columns.T], order, turning)
        return parts.transpose(2, 1, 0)


def local_quaternions(joints: tuple[BvhJoint, ...], values: np.ndarray) -> np.ndarray:
    """(T, J, 4) float64 rotations in the parents' frames, of rows (T, C), in the layout of `RowRotations`."""
    return RowRotations(joints, values)[:]


def _alike(
    joints: tuple[BvhJoint, ...], values: np.ndarray
) -> list[tuple[str, np.ndarray, np.ndarray, tuple[bool, ...]]]:
    """Joints whose rotations are computed together: channel order, joints (n,), columns (n, c), channels that turn.

    In long clips, only joints in which the same channels turn are computed together: many of robots never turn.
    """
    ever = np.asarray(values.any(axis=0))
    found = []
    for order, indices, columns in layout_of(joints).rotations:
        turning = ever[columns]
        if len(values) < _LONG_FRAMES:
            turning[:] = turning.any(axis=0)
        groups: dict[tuple[bool, ...], list[int]] = {}
        for joint, flags in enumerate(turning.tolist()):
            groups.setdefault(tuple(flags), []).append(joint)
        found += [(order, indices[some], columns[some], flags) for flags, some in groups.items()]
    return found


def values_of(bvh: BvhFile, skeleton: Skeleton, motion: Motion, near: np.ndarray | None = None) -> np.ndarray:
    """Rows (T, C) float64 of a motion in the file's own unit, axes and channel orders: the inverse of `motion_of`.

    Args:
        bvh: the file that the motion's skeleton was read from (only its joints are used).
        motion: T frames on that skeleton.
        near: (T, C) rows: of equivalent Euler angles, those nearest to `near` are chosen. Where a row is NaN, or
            without `near`, those nearest to the row before are chosen, so that curves do not jump. Position channels
            of joints without a track take `near`'s value if there is one, else the skeleton's offset.
    """
    frames, columns = motion.frames, sum(len(joint.channels) for joint in bvh.joints)
    guide = np.full((frames, columns), np.nan) if near is None else near
    rotations = motion.rotations.astype(np.float64)
    roots = motion.root_positions.astype(np.float64)
    turn = turn_to_y_up(skeleton.up_axis)
    if turn is not None:
        rotations = multiply(turn.inv().as_quat(), rotations)
        roots = turn.inv().apply(roots)
    local = local_rotations(rotations, skeleton.parents)
    out = np.empty((frames, columns))
    for order, indices, columns in layout_of(bvh.joints).rotations:
        for joint, at in zip(indices, columns, strict=True):
            if order:
                out[:, at] = euler.angles_near(local[:, joint], order, guide[:, at])
    _fill_positions(out, bvh.joints, skeleton, motion, roots, guide)
    return out


def _fill_positions(
    out: np.ndarray,
    joints: tuple[BvhJoint, ...],
    skeleton: Skeleton,
    motion: Motion,
    roots: np.ndarray,
    guide: np.ndarray,
) -> None:
    layout = layout_of(joints)
    tracked = {int(joint): i for i, joint in enumerate(motion.track_joints)}
    for index in np.unique(layout.position_joints):
        axes, columns = layout.positions_of(index)
        if index == 0:
            out[:, columns] = roots[:, axes] / skeleton.unit_m
        elif int(index) in tracked:
            out[:, columns] = motion.tracks[:, tracked[int(index)]][:, axes].astype(np.float64) / skeleton.unit_m
        else:
            still = skeleton.offsets[index][axes] / skeleton.unit_m
            out[:, columns] = np.where(np.isfinite(guide[:, columns]), guide[:, columns], still)
