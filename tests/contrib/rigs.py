"""The add-on's pure parts, and rigs as Blender has them: bones with a rest rotation of their own, Z up."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
from scipy.spatial.transform import Rotation

ADD_ON = Path(__file__).resolve().parents[2] / "contrib" / "blender" / "pumps_blender.py"


def add_on() -> ModuleType:
    """The add-on as a module; it is no part of a package."""
    if "pumps_blender" not in sys.modules:
        spec = importlib.util.spec_from_file_location("pumps_blender", ADD_ON)
        assert spec is not None and spec.loader is not None
        sys.modules["pumps_blender"] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules["pumps_blender"])
    return sys.modules["pumps_blender"]


def random_rig(rng: np.random.Generator, joints: int):
    """A rig in depth-first order with any branching and any rest rotations."""
    parents = [-1]
    for joint in range(1, joints):
        chain, above = [], joint - 1
        while above >= 0:
            chain.append(above)
            above = parents[above]
        parents.append(int(rng.choice(chain)))
    rest = np.tile(np.eye(4), (joints, 1, 1))
    rest[:, :3, :3] = Rotation.random(joints, random_state=rng).as_matrix()
    rest[:, :3, 3] = rng.normal(size=(joints, 3))
    names = tuple(f"Bone.{joint:03d}" for joint in range(joints))
    return add_on().Rig(names, np.array(parents), rest, 0.1 * rng.normal(size=(joints, 3)))


def random_poses(rng: np.random.Generator, rig, frames: int, sliding: bool) -> np.ndarray:
    """(T, J, 4, 4) bones in the world; with `sliding`, every third bone also moves against its parent."""
    out = np.tile(np.eye(4), (frames, len(rig.names), 1, 1))
    for joint, parent in enumerate(rig.parents):
        turn = Rotation.random(frames, random_state=rng).as_matrix()
        place = rng.normal(size=(frames, 3)) if parent < 0 else np.zeros((frames, 3))
        if sliding and joint % 3 == 1:
            place = 0.2 * rng.normal(size=(frames, 3))
        local = np.tile(np.eye(4), (frames, 1, 1))
        local[:, :3, :3], local[:, :3, 3] = turn, place
        rest = rig.rest[joint] if parent < 0 else np.linalg.inv(rig.rest[parent]) @ rig.rest[joint]
        out[:, joint] = (rest if parent < 0 else out[:, parent] @ rest) @ local
    return out
