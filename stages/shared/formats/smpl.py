"""The joints of the SMPL family: names, parents, sizes of a neutral body, and a subject's own from a body model.

Joints in the model's frame at rest: T-pose, Y up, X to the left, facing Z, metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from data_schemas.errors import InputError
from stages.shared.formats.arrays import read_arrays

_Place = tuple[float, float, float]
_FINGERS = ("index", "middle", "pinky", "ring", "thumb")

# Name, parent, head in the parent's frame. A body of about 1.70 m, written for this project from the usual shares of
# stature (legs and arms after Drillis and Contini, 1966: thigh 0.245, shank 0.246, upper arm 0.186, forearm 0.146);
# trunk and hands are estimates. It is neither a person's body nor the mean of a model: directions are right, places
# are within a few centimetres.
_LEFT_OR_MIDDLE: tuple[tuple[str, str, _Place], ...] = (
    ("pelvis", "", (0.0, 0.0, 0.0)),
    ("left_hip", "pelvis", (0.085, -0.05, 0.0)),
    ("spine1", "pelvis", (0.0, 0.10, -0.01)),
    ("left_knee", "left_hip", (0.0, -0.417, 0.0)),
    ("spine2", "spine1", (0.0, 0.13, 0.0)),
    ("left_ankle", "left_knee", (0.0, -0.418, -0.02)),
    ("spine3", "spine2", (0.0, 0.06, 0.01)),
    ("left_foot", "left_ankle", (0.01, -0.05, 0.12)),
    ("neck", "spine3", (0.0, 0.19, -0.02)),
    ("left_collar", "spine3", (0.06, 0.12, -0.01)),
    ("head", "neck", (0.0, 0.10, 0.03)),
    ("left_shoulder", "left_collar", (0.12, 0.03, -0.01)),
    ("left_elbow", "left_shoulder", (0.316, 0.0, 0.0)),
    ("left_wrist", "left_elbow", (0.248, 0.0, 0.0)),
    ("left_hand", "left_wrist", (0.09, 0.0, 0.0)),
    ("jaw", "head", (0.0, -0.02, 0.02)),
    ("left_eye_smplhf", "head", (0.03, 0.06, 0.07)),
    ("left_index1", "left_wrist", (0.095, 0.0, 0.025)),
    ("left_middle1", "left_wrist", (0.1, 0.0, 0.003)),
    ("left_pinky1", "left_wrist", (0.08, 0.0, -0.035)),
    ("left_ring1", "left_wrist", (0.093, 0.0, -0.016)),
    ("left_thumb1", "left_wrist", (0.03, -0.01, 0.03)),
)
_PHALANX: dict[str, tuple[_Place, _Place]] = {
    "index": ((0.033, 0.0, 0.0), (0.024, 0.0, 0.0)),
    "middle": ((0.035, 0.0, 0.0), (0.026, 0.0, 0.0)),
    "pinky": ((0.025, 0.0, -0.003), (0.018, 0.0, -0.002)),
    "ring": ((0.032, 0.0, -0.002), (0.024, 0.0, -0.001)),
    "thumb": ((0.03, -0.005, 0.018), (0.025, -0.003, 0.012)),
}
_BODY = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2", "left_ankle", "right_ankle",
    "spine3", "left_foot", "right_foot", "neck", "left_collar", "right_collar", "head", "left_shoulder",
    "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
)  # fmt: skip
_HANDS = [f"{side}_{finger}{i}" for side in ("left", "right") for finger in _FINGERS for i in (1, 2, 3)]

# The joints of each layout, in the order of its pose vectors.
LAYOUTS: dict[str, tuple[str, ...]] = {
    "body": _BODY,
    "smpl": (*_BODY, "left_hand", "right_hand"),
    "smplh": (*_BODY, *_HANDS),
    "smplx": (*_BODY, "jaw", "left_eye_smplhf", "right_eye_smplhf", *_HANDS),
}
_FOLDERS = {"body": ("smplh", "smplx", "smpl"), "smpl": ("smpl",), "smplh": ("smplh",), "smplx": ("smplx",)}
GENDERS = ("neutral", "male", "female")


@lru_cache(maxsize=1)
def _all_joints() -> dict[str, tuple[str, _Place]]:
    """Parent and head of every joint of all layouts."""
    left = list(_LEFT_OR_MIDDLE)
    for finger, heads in _PHALANX.items():
        left += [(f"left_{finger}{i}", f"left_{finger}{i - 1}", head) for i, head in zip((2, 3), heads, strict=True)]
    whole = {name: (parent, head) for name, parent, head in left}
    for name, parent, (x, y, z) in left:
        if name.startswith("left_"):
            whole[name.replace("left_", "right_")] = (parent.replace("left_", "right_"), (-x, y, z))
    return whole


def parents_of(layout: str) -> tuple[int, ...]:
    """Parents of a layout's joints, -1 for the pelvis."""
    names, joints = LAYOUTS[layout], _all_joints()
    return tuple(names.index(joints[name][0]) if joints[name][0] else -1 for name in names)


@dataclass(frozen=True)
class RestJoints:
    """offsets: J heads in the parents' frames. pelvis: the pelvis' place in the model's frame."""

    offsets: tuple[_Place, ...]
    pelvis: _Place


def neutral_joints(layout: str) -> RestJoints:
    """The joints of the neutral body, used when no body model is given."""
    return RestJoints(tuple(_all_joints()[name][1] for name in LAYOUTS[layout]), (0.0, 0.0, 0.0))


def subject_joints(folder: Path, layout: str, gender: str, betas: np.ndarray) -> RestJoints:
    """The joints of a subject's own body: J_regressor (template + shape directions x betas).

    Args:
        folder: holds smplh/male/model.npz, smplx/SMPLX_MALE.npz and so on.
        betas: (B,) shape parameters; those beyond the model's number are left out.
    Raises: InputError if no model is found or it is damaged.
    """
    path = model_path(folder, layout, gender)
    template, directions = _regressed(str(path), path.stat().st_mtime_ns)
    if len(template) < len(LAYOUTS[layout]):
        raise InputError(f"{path} has {len(template)} joints, but {layout} needs {len(LAYOUTS[layout])}.")
    count = min(len(betas), directions.shape[-1])
    joints = (template + directions[..., :count] @ betas[:count])[: len(LAYOUTS[layout])]
    if not np.isfinite(joints).all():
        raise InputError(f"{path} and the recording's betas give joints that are not finite.")
    parents = np.array(parents_of(layout))
    offsets = joints - joints[parents]
    return RestJoints(tuple(map(tuple, offsets.tolist())), tuple(joints[0].tolist()))


def model_path(folder: Path, layout: str, gender: str) -> Path:
    """The file of a body model. Raises InputError if the folder has none for this layout and gender."""
    tried = []
    for kind in _FOLDERS[layout]:
        upper = f"{kind.upper()}_{gender.upper()}.npz"
        tried += [
            folder / kind / gender / "model.npz",
            folder / gender / "model.npz",
            folder / kind / upper,
            folder / upper,
        ]
    for path in tried:
        if path.is_file():
            return path
    raise InputError(
        f"{folder} has no {layout} body model for the gender {gender}: neither {tried[0]} nor a variant of its name.",
        "Download the model's .npz from its publisher; pickles (.pkl) are never read.",
    )


@lru_cache(maxsize=16)
def _regressed(path: str, stamp: int) -> tuple[np.ndarray, np.ndarray]:
    """Joints of the template (J, 3), and how each shape parameter moves them (J, 3, B)."""
    wanted = ("v_template", "shapedirs", "J_regressor")
    try:
        arrays, pickled = read_arrays(Path(path).read_bytes(), path, wanted)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.") from None
    if pickled or set(arrays) != set(wanted):
        lacking = ", ".join(sorted(set(wanted) - set(arrays)))
        raise InputError(f"{path} lacks plain arrays of {lacking}.", "Use the .npz of its publisher.")
    template, directions, regressor = (np.asarray(arrays[key], np.float64) for key in wanted)
    points = len(template)
    if template.shape != (points, 3) or directions.shape[:2] != (points, 3) or directions.ndim != 3:
        raise InputError(f"{path} is damaged: its points and shape directions differ in number.")
    if regressor.ndim != 2 or regressor.shape[1] != points:
        raise InputError(f"{path} is damaged: its J_regressor does not match its points.")
    return regressor @ template, np.einsum("jv,vkb->jkb", regressor, directions[..., : shapes_of(directions)])


def shapes_of(directions: np.ndarray) -> int:
    """How many of a model's directions (N, 3, B) are of the body's shape; the others are of the face's expression.

    A full model has 300 shape directions, then those of the face; a short SMPL-X file has ten of each.
    """
    return 300 if directions.shape[2] >= 300 else 10 if directions.shape[2] == 20 else directions.shape[2]
