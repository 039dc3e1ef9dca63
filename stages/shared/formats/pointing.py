"""Rotations from joint positions: each joint turns so that its rest bones point in the measured directions.

One child determines only a direction: the joint takes the smallest rotation from its parent's that points the bone
there, which adds no twist. Two or more children determine the whole rotation (Wahba's problem, solved by the singular
value decomposition of Markley 1988). Leaves take their parents' rotations.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from stages.shared.kinematics.rotations import CONJUGATE, multiply, rotate, smallest_turn

_SAME = 1e-9
_PRIOR = 1e-5  # weight of the parent's rotation beside the bones, for what they leave undetermined
_THROUGH = 0.1  # factor on the weight of a bone that runs through joints without measurements
_BLOCK = 4096


def pointed_rotations(
    rest: np.ndarray, parents: Sequence[int], positions: np.ndarray, measured: np.ndarray
) -> np.ndarray:
    """Local rotations (T, J, 4) float32 xyzw.

    Args:
        rest: (J, 3) heads in the parents' frames, parents before children, joint 0 first.
        positions: (T, J, 3) in the world; those of joints that are not measured are ignored.
        measured: (J,) bool; a joint that is not measured keeps its parent's rotation.
    """
    out = np.empty((len(positions), len(parents), 4), np.float32)
    for start in range(0, len(positions), _BLOCK):  # the decomposition needs several arrays of matrices
        block = slice(start, start + _BLOCK)
        out[block] = _pointed(rest, parents, positions[block].astype(np.float64), measured)
    return out


def _pointed(rest: np.ndarray, parents: Sequence[int], positions: np.ndarray, measured: np.ndarray) -> np.ndarray:
    turned = np.zeros((len(positions), len(parents), 4))
    local = np.zeros_like(turned)
    children: list[list[int]] = [[] for _ in parents]
    for joint, parent in enumerate(parents):
        if parent >= 0:
            children[parent].append(joint)
    for joint, parent in enumerate(parents):
        above = turned[:, parent] if parent >= 0 else np.tile([0.0, 0.0, 0.0, 1.0], (len(positions), 1))
        bones = _seen_bones(joint, rest, children, measured) if measured[joint] else []
        turned[:, joint] = _turned(bones, above, positions, joint)
        local[:, joint] = multiply(above * CONJUGATE, turned[:, joint])
    return local


def _seen_bones(
    joint: int, rest: np.ndarray, children: list[list[int]], measured: np.ndarray
) -> list[tuple[int, np.ndarray, float]]:
    """The nearest measured joints below a joint, each with its place in the joint's frame at rest and its weight."""
    found = []
    waiting = [(child, rest[child], True) for child in children[joint]]
    while waiting:
        child, place, straight = waiting.pop()
        if measured[child]:
            if np.linalg.norm(place) > _SAME:
                found.append((child, place, float(np.linalg.norm(place)) * (1.0 if straight else _THROUGH)))
        else:
            waiting += [(below, place + rest[below], False) for below in children[child]]
    return sorted(found, key=lambda bone: bone[0])


def _turned(
    bones: list[tuple[int, np.ndarray, float]], above: np.ndarray, positions: np.ndarray, joint: int
) -> np.ndarray:
    """(T, 4) global rotation of a joint that points its bones, as near as possible to `above`, its parent's."""
    if not bones:
        return above
    aims = np.stack([positions[:, child] - positions[:, joint] for child, *_ in bones], axis=1)
    lengths = np.linalg.norm(aims, axis=-1, keepdims=True)
    aims = np.where(lengths > _SAME, aims / np.maximum(lengths, _SAME), 0.0)  # (T, n, 3)
    places = np.array([place for _, place, _ in bones])
    places /= np.linalg.norm(places, axis=1, keepdims=True)
    weights = np.array([weight for *_, weight in bones])
    if len(bones) == 1 or np.linalg.svd(places, compute_uv=False)[1] < 0.05:  # all on one line
        longest = int(np.argmax(weights))
        return multiply(smallest_turn(rotate(above, places[longest]), aims[:, longest]), above)
    spread = np.einsum("n,tni,nj->tij", weights / weights.sum(), aims, places)
    spread += _PRIOR * Rotation.from_quat(above).as_matrix()
    left, _, right = np.linalg.svd(spread)
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    return Rotation.from_matrix(left @ right).as_quat()
