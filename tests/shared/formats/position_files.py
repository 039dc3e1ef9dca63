"""Files of joint positions for tests: tables, arrays, known lists of joints in poses."""

from __future__ import annotations

import io

import numpy as np
from scipy.spatial.transform import Rotation

from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.joint_lists import LISTS
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.formats.bvh_texts import BvhText

RIG = BvhText(frames=1)

MOVING = BvhText(frames=20, seed=3)


def npy_of(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def csv_of_places(
    names: list[str], places: np.ndarray, joint: str = "{}.{}", separator: str = ",", fps: float = 0
) -> bytes:
    head = [joint.format(name, axis) for name in names for axis in "xyz"]
    rows = [[repr(float(v)) for v in frame.reshape(-1)] for frame in places]
    if fps:
        head, rows = ["time", *head], [[f"{i / fps:.6f}", *row] for i, row in enumerate(rows)]
    return "\n".join(separator.join(row) for row in [head, *rows]).encode()


def true_places() -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Names, places (T, J, 3) in centimetres and global rotations of a BVH."""
    skeleton, motion, _ = motion_of(read_bvh(MOVING.data(), "truth.bvh"))
    return skeleton.names, positions_of(skeleton, motion) * 100, motion.rotations


def posed_list(title: str, rng: np.random.Generator, frames: int) -> np.ndarray:
    """(T, J, 3) a list's T-pose with plausible lengths, every joint turned a little, standing at a metre."""
    joints = LISTS[title]()
    names = [name for name, *_ in joints]
    length = {"knee": 0.42, "foot": 0.4, "ankle": 0.4, "elbow": 0.3, "wrist": 0.25, "hip": 0.1, "shoulder": 0.17}
    out = np.zeros((frames, len(names), 3))
    for frame in range(frames):
        turned: dict[str, Rotation] = {}
        heads: dict[str, np.ndarray] = {}
        waiting = [joint for joint in joints if not joint[1]]
        while waiting:
            name, parent, direction = waiting.pop()
            size = next((v for k, v in length.items() if k in name), 0.18)
            if name.endswith("foot") and title != "h36m17":
                size = 0.15
            unit = np.array(direction) / (np.linalg.norm(direction) or 1.0)
            heads[name] = np.array([0, 1.0, 0]) if not parent else heads[parent] + turned[parent].apply(unit * size)
            own = Rotation.from_rotvec(rng.normal(0, 0.15, 3))
            turned[name] = turned[parent] * own if parent else own
            waiting += [joint for joint in joints if joint[1] == name]
        out[frame] = [heads[name] for name in names]
    return out


NAMES, PLACES, _ = true_places()
