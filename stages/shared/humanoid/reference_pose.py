"""What is found of a skeleton before it can be used: bones' tails, the unit, the up axis.

The zero pose of a file need not be a human pose, so the up axis comes from the motion if possible. Left and right are
found in `stages.shared.humanoid.facing`.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from data_schemas.errors import InputError
from data_schemas.notes import Flag, Note, note
from stages.shared.humanoid.body_groups import LEFT_LEG, RIGHT_LEG, SPINE, BodyParts
from stages.shared.humanoid.joint_names import sense_of

LEAF_LENGTH_M = 0.1
SHORTEST_BONE_M = 1e-3
PLAUSIBLE_STATURE_M = (0.7, 2.6)
_FEASIBLE_STATURE = (1e-6, 1e9)  # in any unit; beyond it float32 loses the body
_POSSIBLE_STATURE_M = (0.2, 20.0)  # of a body in the unit of its format's standard
# Metres in a unit, the most common first; 0.0564 is CMU's (inches divided by 0.45).
_DECIMAL_UNITS = (0.01, 1.0, 0.001, 0.1)
_OTHER_UNITS = (0.0254, 0.0254 / 0.45, 0.3048)
_USUAL_STATURE_M = 1.6  # length of legs and trunk if no common unit gives a human size
_STANDS = 0.75  # least cosine between the trunk, or the legs, and the axis that is up
_Z_UP_TO_Y_UP = Rotation.from_euler("x", -90, degrees=True)


def turn_to_y_up(up_axis: str) -> Rotation | None:
    """The rotation from a source's world to Y up; None if it is Y up already."""
    return _Z_UP_TO_Y_UP if up_axis == "z" else None


def bone_tails(
    names: tuple[str, ...],
    parents: np.ndarray,
    offsets: np.ndarray,
    end_sites: np.ndarray,
    parts: BodyParts,
    leaf_length: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Tail of every bone of the body and whether it is on a main chain.

    Args:
        offsets: (J, 3) heads in the parents' frames. end_sites: (J, 3), zeros if there is none.
        leaf_length: length of a leaf without a usable end site, in the offsets' unit.
    Returns: tails (J, 3) in the joints' own frames, zeros if there is no bone; on_chain (J,) bool.
    """
    joints = len(names)
    tails = np.zeros((joints, 3))
    on_chain = np.zeros(joints, bool)
    children: list[list[int]] = [[] for _ in range(joints)]
    for joint in range(1, joints):
        children[int(parents[joint])].append(joint)
    for chain in parts.chains:
        on_chain[list(chain)] = True
        for joint, following in pairwise(chain):
            tails[joint] = offsets[following]
        last = chain[-1]
        tails[last] = _leaf_tail(last, children[last], names, offsets, end_sites, leaf_length)
    for joint in np.flatnonzero((parts.groups >= 0) & ~on_chain):
        below = children[joint]
        tails[joint] = offsets[below[0]] if below else end_sites[joint]
    return tails, on_chain


def _leaf_tail(
    joint: int,
    children: list[int],
    names: tuple[str, ...],
    offsets: np.ndarray,
    end_sites: np.ndarray,
    leaf_length: float,
) -> np.ndarray:
    """The end of a main chain's last bone: a hand's at its middle finger, head's and toes' at end joint or site."""
    usable = SHORTEST_BONE_M / LEAF_LENGTH_M * leaf_length
    for wanted in ("end", "finger"):
        found = [child for child in children if sense_of(names[child]).part == wanted]
        middle = [child for child in found if sense_of(names[child]).middle]
        rest = [child for child in found if not sense_of(names[child]).thumb]
        for choice in (middle, rest, found):
            if choice and np.linalg.norm(offsets[choice].mean(axis=0)) > usable:
                return offsets[choice].mean(axis=0)
    fan = [child for child in children if sense_of(names[child]).part not in ("face", "helper")]
    if len(fan) >= 3:  # nameless fingers or toes
        return offsets[fan].mean(axis=0)
    if not children and np.linalg.norm(end_sites[joint]) > usable:
        return end_sites[joint]
    onward = float(np.linalg.norm(offsets[joint]))
    return offsets[joint] / onward * leaf_length if onward > 0 else np.zeros(3)


def stature_of(offsets: np.ndarray, parts: BodyParts) -> float:
    """Length of a leg plus the trunk up to the head's joint, in the offsets' unit."""
    lengths = np.linalg.norm(offsets, axis=1)
    leg = np.mean([lengths[list(parts.chains[group])[1:]].sum() for group in (LEFT_LEG, RIGHT_LEG)])
    return float(leg + lengths[list(parts.chains[SPINE])[1:]].sum())


def find_unit(stature: float, usual: float | None = None) -> tuple[float, Note | None]:
    """Metres in one unit of the file, and a note if it is a guess.

    Args:
        stature: of the body, in the file's unit.
        usual: metres in the unit of the format's standard. It is used for dolls and giants too, with a note, but not
            for what can only be a file in another unit.
    Raises: InputError if all bones have zero length, or lengths that no unit brings to a body's size.
    """
    if not stature > 0:
        raise InputError("The skeleton's bones have no length.", "Is its OFFSET data missing?")
    if not _FEASIBLE_STATURE[0] <= stature <= _FEASIBLE_STATURE[1]:
        raise InputError(
            f"The skeleton is {stature:.3g} units tall, which is not a body in any unit.", "Check its OFFSET data."
        )
    low, high = PLAUSIBLE_STATURE_M
    if usual is not None and _POSSIBLE_STATURE_M[0] <= stature * usual <= _POSSIBLE_STATURE_M[1]:
        if low <= stature * usual <= high:
            return usual, None
        return usual, note(Flag.UNIT_UNCERTAIN, unit_m=usual, stature_m=stature * usual, scaled=False)
    for unit in _DECIMAL_UNITS:
        if low <= stature * unit <= high:
            return unit, None
    for unit in _OTHER_UNITS:
        if 1.1 <= stature * unit <= 2.1:
            return unit, note(Flag.UNIT_UNCERTAIN, unit_m=unit, stature_m=stature * unit, scaled=False)
    unit = _USUAL_STATURE_M / stature
    return unit, note(Flag.UNIT_UNCERTAIN, unit_m=unit, stature_m=_USUAL_STATURE_M, scaled=True)


def find_up_axis(rest: np.ndarray, positions: np.ndarray, parts: BodyParts) -> str:
    """The source's up axis, "y" or "z".

    Args:
        rest: (J, 3) joints at zero rotations, in the file's axes; used only if they form a standing pose.
        positions: (F, J, 3) joints in a few frames of the motion, file's axes.
    """
    feet = [parts.chains[LEFT_LEG][-1], parts.chains[RIGHT_LEG][-1]]
    hips = [parts.chains[LEFT_LEG][0], parts.chains[RIGHT_LEG][0]]
    head = parts.chains[SPINE][-1]
    body = positions[:, head] - positions[:, feet].mean(axis=1)
    length = np.linalg.norm(body, axis=-1, keepdims=True)
    upward = (body / np.maximum(length, 1e-9)).mean(axis=0)
    standing = rest_axis(rest, parts)
    if standing is None:
        return "z" if upward[2] > max(upward[1], 0.5) else "y"
    other = {"y": 2, "z": 1}[standing]
    leg = np.linalg.norm(positions[:, feet] - positions[:, hips], axis=-1).max()
    lowest = np.percentile(positions[:, feet, other], 5)
    # The motion overrides the rest pose only if the body stands upright along the other axis, not if it lies down.
    if upward[other] > 0.85 and abs(lowest) < 0.25 * leg:
        return "z" if other == 2 else "y"
    return standing


def standing_axis_of_poses(positions: np.ndarray, parts: BodyParts) -> str | None:
    """The axis, "y" or "z", along which a body stands: head over pelvis over feet, feet on a level floor.

    A body that lies along Y on the floor of a Z-up world looks like one that stands in a Y-up world. It is recognised
    by its joints, which are all near the floor.

    Args:
        positions: (F, J, 3) joints in some poses, metres, in the file's axes.
    Returns: None if the poses do not show it clearly.
    """
    feet = positions[:, [parts.chains[LEFT_LEG][-1], parts.chains[RIGHT_LEG][-1]]].mean(axis=1)
    head = positions[:, parts.chains[SPINE][-1]]
    hips = positions[:, [parts.chains[LEFT_LEG][0], parts.chains[RIGHT_LEG][0]]].mean(axis=1)
    upward = [np.median(_units(upper - lower), axis=0) for upper, lower in ((head, hips), (hips, feet))]
    low, high = positions.min(axis=1), positions.max(axis=1)
    stature = float(np.median(np.linalg.norm(head - hips, axis=1) + np.linalg.norm(hips - feet, axis=1)))
    found = []
    for axis, name in ((1, "y"), (2, "z")):
        other = 3 - axis
        stands = min(part[axis] for part in upward) > _STANDS
        lies = _is_flat(low[:, other], high[:, other], stature) and abs(np.median(low[:, axis])) > 0.3 * stature
        if stands and not lies:
            found.append(name)
    return found[0] if len(found) == 1 else None


def _is_flat(low: np.ndarray, high: np.ndarray, stature: float) -> bool:
    """Whether the body is all near the floor at 0."""
    return bool(np.median(np.abs(low)) < 0.1 * stature and np.percentile(high, 95) < 0.45 * stature)


def _units(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)


def rest_axis(rest: np.ndarray, parts: BodyParts) -> str | None:
    """The axis, "y" or "z", along which a body stands at rest; None if its rest pose does not stand.

    Args:
        rest: (J, 3) joints at zero rotations.
    """
    feet = [parts.chains[LEFT_LEG][-1], parts.chains[RIGHT_LEG][-1]]
    hips = [parts.chains[LEFT_LEG][0], parts.chains[RIGHT_LEG][0]]
    legs = rest[feet] - rest[hips]
    trunk = rest[parts.chains[SPINE][-1]] - rest[hips].mean(axis=0)
    sizes = np.linalg.norm(np.vstack([legs, trunk]), axis=1)
    if (sizes < 1e-9).any():
        return None
    legs, trunk = legs / sizes[:2, None], trunk / sizes[2]
    for axis, name in ((1, "y"), (2, "z")):
        if trunk[axis] > 0.8 and (legs[:, axis] < -0.7).all():
            return name
    return None
