"""AMASS files and body models for tests, in the layouts that are met; every number from a seed."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from stages.shared.formats.smpl import LAYOUTS, neutral_joints, parents_of

STANDING = np.array([0, 0, 0.95])


def npz(**arrays: object) -> bytes:
    """The bytes of a .npz."""
    stream = io.BytesIO()
    np.savez(stream, **arrays)  # type: ignore[arg-type]
    return stream.getvalue()


def pose_vectors(layout: str, frames: int = 8, seed: int = 0) -> np.ndarray:
    """(T, 3 J): a body that stands upright in a world whose Z is up, with small turns of all joints."""
    rng = np.random.default_rng(seed)
    vectors = rng.normal(0, 0.2, (frames, len(LAYOUTS[layout]), 3))
    vectors[:, 0] = [np.pi / 2, 0, 0]
    return vectors.reshape(frames, -1)


def old_layout(layout: str = "smplh", frames: int = 8, **changed: object) -> bytes:
    """As AMASS gave it first: poses, mocap_framerate, dmpls. A key changed to None is left out."""
    rng = np.random.default_rng(1)
    keys = {
        "poses": pose_vectors(layout, frames), "trans": rng.normal(0, 0.1, (frames, 3)) + STANDING,
        "betas": rng.normal(0, 1, 16), "gender": np.array("male"), "mocap_framerate": np.array(120.0),
        "dmpls": rng.normal(0, 1, (frames, 8)),
    }  # fmt: skip
    keys.update(changed)  # type: ignore[arg-type]
    return npz(**{key: value for key, value in keys.items() if value is not None})


def new_layout(frames: int = 8, **changed: object) -> bytes:
    """As AMASS gives SMPL-X: parts of the pose, mocap_frame_rate, surface_model_type."""
    vectors = pose_vectors("smplx", frames)
    rng = np.random.default_rng(1)
    keys = {
        "root_orient": vectors[:, :3], "pose_body": vectors[:, 3:66], "pose_jaw": vectors[:, 66:69],
        "pose_eye": vectors[:, 69:75], "pose_hand": vectors[:, 75:], "trans": rng.normal(0, 0.1, (frames, 3)),
        "betas": rng.normal(0, 1, 16), "gender": np.array("female"), "mocap_frame_rate": np.array(100),
        "surface_model_type": np.array("smplx"), "mocap_time_length": np.array(frames / 100),
        "num_betas": np.array(16),
    }  # fmt: skip
    keys.update(changed)  # type: ignore[arg-type]
    return npz(**{key: value for key, value in keys.items() if value is not None})


def body_model(path: Path, layout: str, betas: int = 16, points: int = 90, seed: int = 3) -> dict[str, np.ndarray]:
    """Write a made-up body model to `path` and return its arrays: a cloud of points about the neutral figure."""
    rng = np.random.default_rng(seed)
    rest, parents = neutral_joints(layout), np.array(parents_of(layout))
    heads = np.array(rest.offsets)
    for joint in range(1, len(parents)):
        heads[joint] += heads[parents[joint]]
    joints = len(parents)
    owner = np.arange(points) % joints
    regressor = (owner[None] == np.arange(joints)[:, None]) / np.bincount(owner, minlength=joints)[:, None]
    arrays = {
        "v_template": heads[owner] + rng.normal(0, 0.02, (points, 3)) + [0, -0.2, 0.03],
        "shapedirs": rng.normal(0, 0.01, (points, 3, betas)), "J_regressor": regressor,
        "posedirs": rng.normal(0, 0.01, (points, 3, 9 * (joints - 1))), "weights": regressor.T * 1.0,
        "kintree_table": np.stack([np.where(parents < 0, 0, parents), np.arange(joints)]), "f": np.zeros((1, 3), int),
    }  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **arrays)  # type: ignore[arg-type]
    return arrays
