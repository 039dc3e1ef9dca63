"""SMPL's parameters as rotation matrices, in every shape, give the motion of the same rotation vectors."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from data_schemas.errors import InputError
from stages.shared.formats.amass import read_amass
from stages.shared.formats.recording import Asked, Recording
from stages.shared.formats.smpl import LAYOUTS
from stages.shared.formats.smpl_keys import pose_vectors as vectors_of
from tests.shared.formats.amass_files import new_layout, npz, old_layout, pose_vectors

FRAMES = 8


def read(data: bytes) -> Recording:
    (recording,) = read_amass(data, "result.npz", Asked())
    return recording


def matrices(vectors: np.ndarray) -> np.ndarray:
    """(T, J, 3, 3) float32 of rotation vectors (T, 3 J)."""
    turned = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix()
    return turned.reshape(len(vectors), -1, 3, 3).astype(np.float32)


def same(one: Recording, other: Recording) -> bool:
    apart = np.abs((one.motion.rotations * other.motion.rotations).sum(-1))
    return one.skeleton.names == other.skeleton.names and bool(apart.min() > 1 - 1e-5)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("shape", [(FRAMES, -1, 3, 3), (1, FRAMES, -1, 3, 3), (FRAMES, -1, 9), (FRAMES, -1)])
def test_whole_poses(layout: str, shape: tuple[int, ...]) -> None:
    made = matrices(pose_vectors(layout)).reshape(shape)
    assert same(read(old_layout(layout, poses=made)), read(old_layout(layout)))


@pytest.mark.parametrize("frames", [1, 3, FRAMES])
def test_parts_of_the_pose_each_in_its_own_form(frames: int) -> None:
    vectors = pose_vectors("smplx", frames)
    made = {
        "root_orient": matrices(vectors[:, :3])[:, 0], "pose_body": matrices(vectors[:, 3:66]),
        "pose_eye": matrices(vectors[:, 69:75]).reshape(frames, -1), "pose_hand": matrices(vectors[:, 75:]),
    }  # fmt: skip
    assert same(read(new_layout(frames, **made)), read(new_layout(frames)))


@pytest.mark.parametrize("joints, layout", [(21, "body"), (23, "smpl")])
def test_names_of_the_smplx_package(joints: int, layout: str) -> None:
    """As the video estimators write them: (T, 1, 3, 3) and (T, J, 3, 3)."""
    vectors = pose_vectors(layout)
    place = np.zeros((FRAMES, 3))
    plain = npz(global_orient=vectors[:, :3], body_pose=vectors[:, 3:], transl=place)
    turned = npz(global_orient=matrices(vectors[:, :3]), body_pose=matrices(vectors[:, 3:]), transl=place)
    assert matrices(vectors[:, 3:]).shape == (FRAMES, joints, 3, 3)
    assert same(read(turned), read(plain))


def test_hands_as_matrices() -> None:
    vectors = pose_vectors("smplx")
    hands = {"left_hand_pose": vectors[:, 75:120], "right_hand_pose": vectors[:, 120:]}
    arms = {"global_orient": vectors[:, :3], "body_pose": vectors[:, 3:66], "transl": np.zeros((FRAMES, 3))}
    turned = {key: matrices(values).reshape(FRAMES, -1) for key, values in hands.items()}
    assert same(read(npz(**arms, **turned)), read(npz(**arms, **hands)))


def test_three_vectors_of_one_joint_are_not_a_matrix() -> None:
    vectors = np.random.default_rng(0).normal(0, 0.3, (3, 66))
    arrays = {"root_orient": vectors[None, :, :3], "pose_body": vectors[:, 3:]}
    assert np.array_equal(vectors_of(arrays, "a")[0], vectors)


@pytest.mark.parametrize("fault", ["mirror", "scale", "noise", "zero"])
@pytest.mark.parametrize("key", ["poses", "body_pose"])
def test_matrices_that_are_no_rotations_are_refused_by_name(key: str, fault: str) -> None:
    made = matrices(pose_vectors("body"))
    last = made[-1, 4]
    made[-1, 4] = {"mirror": -last, "scale": 1.2 * last, "noise": last + 0.1, "zero": 0 * last}[fault]
    data = old_layout("body", poses=made)
    if key == "body_pose":
        data = npz(global_orient=made[:, :1], body_pose=made[:, 1:], transl=np.zeros((FRAMES, 3)))
    with pytest.raises(InputError, match=rf"result\.npz: {key} .*are no rotations"):
        read(data)


@pytest.mark.parametrize("key", ["trans", "transl"])
def test_an_error_names_the_key_that_the_file_has(key: str) -> None:
    arrays = {"trans": None, key: np.zeros((FRAMES, 4))}
    with pytest.raises(InputError, match=rf": {key} has the shape \(8, 4\)"):
        read(old_layout(**arrays))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0, np.pi))
def test_any_rotations(seed: int, size: float) -> None:
    vectors = np.random.default_rng(seed).normal(0, size, (5, 66))
    found, notes = vectors_of({"poses": matrices(vectors)}, "a")
    back = Rotation.from_rotvec(found.reshape(-1, 3)) * Rotation.from_rotvec(vectors.reshape(-1, 3)).inv()
    assert back.magnitude().max() < 1e-3 and notes == []
