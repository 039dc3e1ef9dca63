"""The pose vectors of SMPL's files, under AMASS' names of arrays and under those of the smplx package.

Arrays may have a leading axis of 1 (a batch of one). A pose is rotation vectors, (T, J, 3) or (T, 3 J), or rotation
matrices, (T, J, 3, 3), (T, J, 9) or (T, 9 J).
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping

import numpy as np

from data_schemas.errors import InputError
from data_schemas.notes import Flag, Note, note
from stages.shared.formats.smpl import LAYOUTS

# AMASS' part of the pose: its joints, and the names of smplx' arrays that make it up.
_PARTS = {
    "root_orient": ((1,), ("global_orient",)),
    "pose_body": ((21, 23), ("body_pose",)),
    "pose_jaw": ((1,), ("jaw_pose",)),
    "pose_eye": ((2,), ("leye_pose", "reye_pose")),
    "pose_hand": ((30,), ("left_hand_pose", "right_hand_pose")),
}
_FACE_AND_HANDS = ("pose_jaw", "pose_eye", "pose_hand")
_JOINTS = tuple(len(names) for names in LAYOUTS.values())
_WIDTHS = tuple(3 * joints for joints in _JOINTS)
_NOT_ORTHOGONAL = 0.02  # largest element of R R^T - I; half precision and PyTorch's solvers stay below 0.005
_BLOCK = 1 << 16  # matrices
SMPLX_NAMES = tuple(name for _, names in _PARTS.values() for name in names)
POSE_NAMES = ("poses", *_PARTS, *SMPLX_NAMES)
PLACE_NAMES = ("trans", "transl")


def names_smplx(listed: Container[str]) -> bool:
    """Whether a file has the pose under the smplx package's names."""
    return "global_orient" in listed and "body_pose" in listed


def is_smpl(listed: set[str]) -> bool:
    """Whether the arrays with these names are a recording of SMPL's parameters."""
    return "poses" in listed or {"root_orient", "pose_body"} <= listed or names_smplx(listed)


def pose_vectors(arrays: Mapping[str, np.ndarray], name: str) -> tuple[np.ndarray, list[Note]]:
    """(T, 3 J) rotation vectors, root first, and notes on what was left out.

    Args:
        arrays: finite numbers by the names in POSE_NAMES.
    Raises: InputError naming the file where a pose is missing or has another shape.
    """
    if "poses" in arrays:
        return _whole(arrays["poses"], name), []
    parts, notes = _parts(arrays, name)
    if "root_orient" not in parts or "pose_body" not in parts:
        raise InputError(
            f"{name} has neither poses, nor root_orient and pose_body, nor global_orient and body_pose.",
            "Is this a recording of SMPL's parameters?",
        )
    if len({len(part) for part in parts.values()}) > 1:
        raise InputError(f"{name}: its parts of the pose differ in their number of frames.")
    frames = len(parts["root_orient"])
    if "pose_jaw" in parts or "pose_eye" in parts:  # SMPL-X has a jaw, eyes and hands, or none of them
        for key in _FACE_AND_HANDS:
            parts.setdefault(key, np.zeros((frames, 3 * _PARTS[key][0][0]), parts["pose_body"].dtype))
    return np.concatenate([parts[key] for key in _PARTS if key in parts], axis=1), notes


def places_of(array: np.ndarray) -> np.ndarray:
    """The pelvis' path without a leading axis of 1."""
    return array[0] if array.ndim == 3 and len(array) == 1 else array


def _whole(array: np.ndarray, name: str) -> np.ndarray:
    shape = array.shape
    if matrices := _matrix_joints(array, _JOINTS, f"{name}: poses"):
        return _vectors(array, matrices)
    if shape[:1] == (1,) and (array.ndim == 4 or (array.ndim == 3 and shape[2] in _WIDTHS)):
        array = array[0]
    if array.ndim == 3 and array.size:
        array = array.reshape(len(array), -1)
    if array.ndim != 2 or len(array) == 0:
        raise InputError(f"{name}: its poses have the shape {shape}, expected frames by numbers.")
    return array


def _parts(arrays: Mapping[str, np.ndarray], name: str) -> tuple[dict[str, np.ndarray], list[Note]]:
    """The parts of the pose under AMASS' names, each (T, 3 J)."""
    parts: dict[str, np.ndarray] = {}
    notes: list[Note] = []
    for key, (joints, others) in _PARTS.items():
        if key in arrays:
            parts[key] = _rows(arrays[key], joints, f"{name}: {key}")
        elif all(other in arrays for other in others):
            each = tuple(count // len(others) for count in joints)
            where = {other: f"{name}: {other}" for other in others}
            if key == "pose_hand" and not all(
                _row_joints(arrays[other], each) or _matrix_joints(arrays[other], each, where[other])
                for other in others
            ):
                notes.append(note(Flag.HANDS_LEFT_OUT))
                continue
            halves = [_rows(arrays[other], each, where[other]) for other in others]
            if len({len(half) for half in halves}) > 1:
                raise InputError(f"{name}: its parts of the pose differ in their number of frames.")
            parts[key] = np.concatenate(halves, axis=1)
    return parts, notes


def _rows(array: np.ndarray, joints: tuple[int, ...], where: str) -> np.ndarray:
    """The array as (T, 3 J), J one of `joints`. Raises InputError naming `where` if its shape is another one."""
    if array.ndim < 2 or not array.size:
        raise InputError(f"{where} has no frames or no numbers.")
    if matrices := _matrix_joints(array, joints, where):
        return _vectors(array, matrices)
    count = _row_joints(array, joints)
    if not count:
        numbers = " or ".join(str(3 * each) for each in joints)
        matrices = " or ".join(str(9 * each) for each in joints)
        raise InputError(
            f"{where} has the shape {array.shape}, expected frames by {numbers} numbers (rotation vectors) or"
            f" {matrices} (rotation matrices)."
        )
    return array.reshape(-1, 3 * count)


def _row_joints(array: np.ndarray, joints: tuple[int, ...]) -> int:
    """The number of joints of each frame, 0 if the shape fits none; axes before the frames must be of length 1."""
    return next((count for count in joints if _frames_by(array.shape, ((3 * count,), (count, 3)))), 0)


def _frames_by(shape: tuple[int, ...], tails: Iterable[tuple[int, ...]]) -> bool:
    """Whether a shape is (T, *tail) or (1, T, *tail) with one of the tails."""
    return any(shape[1:] == tail or (shape[:1] == (1,) and shape[2:] == tail) for tail in tails)


def _matrix_joints(array: np.ndarray, joints: tuple[int, ...], where: str) -> int:
    """The number of joints of which each frame holds a rotation matrix, 0 if it holds something else.

    Raises: InputError if the array has the shape of matrices, and its numbers are no rotations.
    """
    for count in joints:
        tails = [(count, 3, 3), (count, 9), (9 * count,)] + [(3, 3)] * (count == 1)
        if array.size and _frames_by(array.shape, tails):
            if _are_rotations(array.reshape(-1, 3, 3)):
                return count
            if not _row_joints(array, joints):  # one matrix of one joint has the shape of three of its vectors
                raise InputError(
                    f"{where} has the shape {array.shape} of rotation matrices, and its numbers are no rotations."
                )
    return 0


def _are_rotations(matrices: np.ndarray) -> bool:
    """Whether all of the matrices (N, 3, 3) are rotations, within rounding errors."""
    for start in range(0, len(matrices), _BLOCK):
        block = matrices[start : start + _BLOCK].astype(np.float64)
        off = np.abs(block @ block.transpose(0, 2, 1) - np.eye(3)).max()
        if not (off < _NOT_ORTHOGONAL and (np.linalg.det(block) > 0).all()):
            return False
    return True


def _vectors(array: np.ndarray, joints: int) -> np.ndarray:
    """(T, 3 J) float32 rotation vectors of an array that holds J rotation matrices for each frame."""
    from scipy.spatial.transform import Rotation  # only now: the list of formats is shown without SciPy

    matrices = array.reshape(-1, 3, 3)
    out = np.empty((len(matrices), 3), np.float32)
    for start in range(0, len(matrices), _BLOCK):
        block = matrices[start : start + _BLOCK].astype(np.float64)
        out[start : start + _BLOCK] = Rotation.from_matrix(block).as_rotvec()
    return out.reshape(-1, 3 * joints)
