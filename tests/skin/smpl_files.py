"""A small body model in the layout of the publisher's .npz, and recordings of its parameters, for tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stages.shared.formats.smpl import LAYOUTS, neutral_joints, parents_of

JOINTS = len(LAYOUTS["smplh"])


def write_model(path: Path, seed: int = 0, **changed: np.ndarray) -> dict[str, np.ndarray]:
    """A tetrahedron about every joint of SMPL-H, one corner of which also hangs on the joint above."""
    rng = np.random.default_rng(seed)
    parents = np.array(parents_of("smplh"))
    heads = np.array(neutral_joints("smplh").offsets)
    for joint in range(1, JOINTS):
        heads[joint] += heads[parents[joint]]
    corners = 0.03 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    weights = np.zeros((4 * JOINTS, JOINTS))
    regressor = np.zeros((JOINTS, 4 * JOINTS))
    for joint in range(JOINTS):
        weights[4 * joint : 4 * joint + 4, joint] = 1
        regressor[joint, 4 * joint : 4 * joint + 4] = 0.25
        if joint:
            weights[4 * joint, [joint, parents[joint]]] = 0.5
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    arrays = {
        "v_template": (heads[:, None] + corners).reshape(-1, 3),
        "shapedirs": 0.01 * rng.normal(size=(4 * JOINTS, 3, 16)),
        "posedirs": 0.003 * rng.normal(size=(4 * JOINTS, 3, 9 * (JOINTS - 1))),
        "J_regressor": regressor,
        "weights": weights,
        "kintree_table": np.stack([np.array([2**32 - 1, *parents[1:]], np.int64), np.arange(JOINTS)]),
        "f": (4 * np.arange(JOINTS)[:, None, None] + faces).reshape(-1, 3).astype(np.uint32),
    } | changed
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **arrays)
    return arrays


def write_recording(path: Path, frames: int = 20, gender: str = "female", seed: int = 1) -> dict[str, np.ndarray]:
    """Standing and moving a little, Z up as in AMASS, 25 frames a second."""
    rng = np.random.default_rng(seed)
    poses = np.cumsum(0.01 * rng.normal(size=(frames, 3 * JOINTS)), axis=0)
    poses[:, :3] += [np.pi / 2, 0, 0]
    arrays = {
        "poses": poses,
        "trans": np.cumsum(0.01 * rng.normal(size=(frames, 3)), axis=0),
        "betas": rng.normal(size=16),
        "gender": np.array(gender),
        "mocap_framerate": np.array(25.0),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **arrays)
    return arrays
