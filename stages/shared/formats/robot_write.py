"""A motion as the joint angles of a robot: rows of a place, a quaternion and an angle for every joint that turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.hinge_fit import fit_hinges
from stages.shared.formats.robot_rig import TO_ROBOT, RobotRig
from stages.shared.formats.robot_table import USUAL_DECIMALS, lines_of_rows
from stages.shared.kinematics.rotations import continuous_signs

_SAME_PLACE_M = 5e-3
_FAULTS_SHOWN = 8


@dataclass(frozen=True)
class RobotRows:
    """A motion as rows.

    values:  (T, 7 + M) x, y, z in metres, Z up; qx, qy, qz, qw; M angles in radians, in the URDF's order.
    beyond:  (T, M) bool, angles outside their limits; with `limited`, angles that are held at a limit.
    off_m:   (T,) largest distance of a joint from its place in the motion.
    fitted:  (T,) bool, frames in which joints turned about other axes than the robot's.
    """

    values: np.ndarray
    beyond: np.ndarray
    off_m: np.ndarray
    fitted: np.ndarray


def rows_of_motion(
    rig: RobotRig, skeleton: Skeleton, motion: Motion, name: str, *, limited: bool = False
) -> RobotRows:
    """The rows of a motion on the robot's joints.

    Args:
        skeleton: has the robot's joints by name, at the same places; further joints, such as fingers, are left out.
        limited: True to keep angles within the URDF's limits.
    Raises: InputError listing what differs.
    """
    order = _joints_of(rig, skeleton, name)
    rotations = motion.rotations[:, order].astype(np.float64)
    rotations /= np.linalg.norm(rotations, axis=-1, keepdims=True)
    found = fit_hinges(rig.hinges, rotations, motion.fps, limited=limited)
    root = rotations[:, 0][:, (*TO_ROBOT, 3)]
    root = continuous_signs(root if root[0, 3] >= 0 else -root)
    values = np.hstack([motion.root_positions.astype(np.float64)[:, TO_ROBOT], root, found.angles])
    beyond = found.held if limited else rig.hinges.beyond(found.angles)
    return RobotRows(values, beyond, found.off_m, found.fitted)


def notes_of_rows(rig: RobotRig, rows: RobotRows, *, limited: bool) -> list[str]:
    """Notes for the user on the rows, one sentence each."""
    notes = []
    if rows.fitted.any():
        off = rows.off_m[rows.fitted] * 1000
        notes.append(
            f"In {rows.fitted.sum()} of {len(rows.fitted)} frames joints turn about other axes than the robot's; its"
            f" angles bring the worst joint of a frame to within {off.mean():.0f} mm, and {off.max():.0f} at most."
        )
    count = int(rows.beyond.any(axis=1).sum())
    if count:
        often = rows.beyond.sum(axis=0)
        worst = int(often.argmax())
        said = "are held at a limit" if limited else "lie beyond the robot's limits"
        notes.append(
            f"Angles of {count} of {len(rows.beyond)} frames {said}, most often {rig.angle_names[worst]}"
            f" ({often[worst]}){'' if limited else '; --respect-limits keeps them within'}."
        )
    return notes


def csv_of_rows(values: np.ndarray, decimals: int = USUAL_DECIMALS) -> bytes:
    """Rows as text, without a line of names, which is the common form of such files."""
    return b"".join(line + b"\n" for line in lines_of_rows(values, decimals))


def _joints_of(rig: RobotRig, skeleton: Skeleton, name: str) -> list[int]:
    """For every joint of the rig its index in the skeleton; joints that never turn may be missing."""
    index = {joint: at for at, joint in enumerate(skeleton.names)}
    faults: list[str] = []
    order: list[int] = []
    for joint, (title, parent) in enumerate(zip(rig.names, rig.hinges.parents.tolist(), strict=True)):
        at = index.get(title)
        if at is None:
            if rig.hinges.columns[joint] >= 0 or joint == 0:
                faults.append(f"it has no joint {title}")
            order.append(order[parent] if parent >= 0 else 0)
            continue
        order.append(at)
        above = skeleton.names[skeleton.parents[at]] if skeleton.parents[at] >= 0 else ""
        if joint == 0 or rig.hinges.columns[joint] < 0:
            continue
        if above != rig.names[parent]:
            faults.append(f"{title} hangs on {above or 'nothing'} there and on {rig.names[parent]} on the robot")
        elif (apart := np.linalg.norm(skeleton.offsets[at] - rig.hinges.offsets[joint])) > _SAME_PLACE_M:
            faults.append(f"{title} is {apart * 1000:.0f} mm from where the robot has it")
    if not faults and order[0] != 0:
        faults.append(f"{rig.names[0]} is not its first joint")
    if faults:
        more = f", and {len(faults) - _FAULTS_SHOWN} more" if len(faults) > _FAULTS_SHOWN else ""
        raise InputError(
            f"{name} is not on the robot of {rig.source}: {', '.join(faults[:_FAULTS_SHOWN])}{more}.",
            "`pumps retarget --to` the URDF puts it there.",
        )
    return order


def spelled_as_keys(values: np.ndarray, keys: np.ndarray, key_values: np.ndarray) -> np.ndarray:
    """Rows (T, 7 + M) with the quaternion's sign and the whole turns of angles as the key before them has them.

    Args:
        keys: (K,) their rows here, rising. key_values: (K, 7 + M).
    """
    before = np.clip(np.searchsorted(keys, np.arange(len(values)), side="right") - 1, 0, None)
    out = values.copy()
    turns = np.round((key_values[:, 7:] - values[keys, 7:]) / (2 * np.pi)) * 2 * np.pi
    out[:, 7:] += turns[before]
    same = (key_values[:, 3:7] * values[keys, 3:7]).sum(axis=1)
    out[:, 3:7] *= np.where(same < 0, -1.0, 1.0)[before, None]
    return out
