"""Data sets of labelled joint positions, in the layouts that their public code reads: HumanAct12 and UESTC.

No file of theirs comes with pumps, and both are for research. Their positions are in the axes of a camera, Y down;
they are turned to Y up here. pumps reads no pickle: the arrays of UESTC's pickle are to be saved as .npy first.

HumanAct12 (as Action2Motion reads it): a folder of `P01G01R01F0001T0064A0101.npy`, each (T, 24, 3) metres at 20
frames a second, the joints of SMPL; the two digits after A are the action. There is no official split: subjects 11
and 12 are held out here, and subject 10 is for validation.

UESTC (as ACTOR reads it): `info/names.txt`, one video a line (`a26_d2_p098_c2_color.avi`: action, view, subject,
side), `info/action_classes.txt`, one name a line, and, for the list `joints3d` of `vibe_cache_refined.pkl`, a file
`joints3d/<video without .avi>.npy`, (T, 49, 3) metres at 30 frames a second. Views of side 2 are turned to the front;
view 8 of side 2 is left out. The split is the official one across subjects; every tenth training subject validates.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_schemas.clips import ClipRow
from data_schemas.concepts import StoredBody
from data_schemas.errors import InputError
from data_schemas.manifest import sha256_of_file
from stages.shared.concepts.actions import HUMANACT12, HUMANACT12_NAME
from stages.shared.concepts.body_positions import STATURE_M
from stages.shared.formats.arrays import read_array
from stages.shared.formats.joint_lists import LISTS
from stages.shared.humanoid.body_groups import BodyParts, find_body_parts
from stages.shared.humanoid.reference_pose import stature_of
from stages.shared.kinematics.rotations import turned_about_y

_HUMANACT12_FPS, _UESTC_FPS = 20.0, 30.0
_TEST_SUBJECTS, _VAL_SUBJECTS = (11, 12), (10,)
_UESTC_NAME = re.compile(r"a(\d+)_d(\d+)_p(\d+)_c(\d+)_color(?:\.avi)?")
_UESTC_TRAINING = (
    1, 2, 6, 12, 13, 16, 21, 24, 28, 29, 30, 31, 33, 35, 39, 41, 42, 45, 47, 50, 52, 54, 55, 57, 59, 61, 63, 64, 67,
    69, 70, 71, 73, 77, 81, 84, 86, 87, 88, 90, 91, 93, 96, 99, 102, 103, 104, 107, 108, 112, 113,
)  # fmt: skip
# Joints of VIBE's 49 that Action2Motion and ACTOR keep, with the pelvis first.
_OF_VIBE = (8, 1, 2, 3, 4, 5, 6, 7, 0, 9, 10, 11, 12, 13, 14, 21, 24, 38)
_VIBE_NAMES = (
    "hip", "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist",
    "nose", "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle", "left_heel",
    "right_heel", "head",
)  # fmt: skip
_VIBE_PARENTS = (-1, 0, 1, 2, 3, 1, 5, 6, 1, 0, 9, 10, 0, 12, 13, 14, 11, 1)
_LICENCE = "for research, as its publishers state"


@dataclass(frozen=True)
class LabelledPositions:
    """One clip: its row, whose skeleton is the body's id, its body, positions (T, J, 3) metres, Y up, the scale to
    standard stature, its action, and notes on its file."""

    row: ClipRow
    body: StoredBody
    positions: np.ndarray
    scale: float
    action: str
    notes: tuple[str, ...] = ()


def positions_of_data_set(name: str, folder: Path) -> list[LabelledPositions]:
    """The clips of `humanact12` or `uestc` in a folder.

    Raises: InputError naming the file that is missing or bad.
    """
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder.", "Give the folder of the data set.")
    return _humanact12(folder) if name == "humanact12" else _uestc(folder)


def body_of_list(title: str) -> StoredBody:
    """The body of a list of joints: "smpl24", or "vibe18" for the joints of UESTC and NTU."""
    if title == "vibe18":
        return body_of_joints(_VIBE_NAMES, _VIBE_PARENTS)
    joints = LISTS[title]()
    names = tuple(name for name, *_ in joints)
    return body_of_joints(names, [names.index(parent) if parent else -1 for _, parent, _ in joints])


def y_up(positions: np.ndarray) -> np.ndarray:
    """Positions (..., 3) of a camera's axes, Y down and Z away, turned half about X."""
    return positions * np.array([1.0, -1.0, -1.0], positions.dtype)


def scale_of_positions(body: StoredBody, positions: np.ndarray) -> float:
    """What brings a body of positions (T, J, 3) to the standard stature, by its mean bone lengths."""
    lengths = np.zeros((len(body.names), 3))
    below = np.arange(1, len(body.names))
    lengths[below, 1] = np.linalg.norm(positions[:, below] - positions[:, body.parents[below]], axis=-1).mean(axis=0)
    stature = stature_of(lengths, _parts(body.names, body.parents))
    if not stature > 0:
        raise InputError("The bones of the legs and the trunk have no length.", "Are these positions of joints?")
    return STATURE_M / stature


def body_of_joints(names: Sequence[str], parents: Sequence[int]) -> StoredBody:
    """The body of named joints, parents first, with its groups by their names."""
    above = np.array(parents, np.int32)
    return StoredBody(tuple(names), above, _parts(tuple(names), above).groups)


def _parts(names: tuple[str, ...], parents: np.ndarray) -> BodyParts:
    """The parts of a body by its joints' names; lengths of one for all bones, since measured ones may be odd."""
    offsets = np.tile((0.0, 1.0, 0.0), (len(names), 1))
    return find_body_parts(names, parents, offsets, np.zeros(len(names)))


def _humanact12(folder: Path) -> list[LabelledPositions]:
    files = [
        (path, found)
        for path in sorted(folder.iterdir())
        if path.suffix == ".npy" and (found := HUMANACT12_NAME.fullmatch(path.stem)) is not None
    ]
    if not files:
        raise InputError(
            f"{folder} holds no file named like P01G01R01F0001T0064A0101.npy.", "Give the folder HumanAct12."
        )
    body = body_of_list("smpl24")
    found = []
    for path, name in files:
        subject, action = int(name["subject"]), int(name["coarse"])
        if not 1 <= action <= len(HUMANACT12):
            raise InputError(f"{path} is of the action {action}, and there are 1 to {len(HUMANACT12)}.")
        split = "test" if subject in _TEST_SUBJECTS else "val" if subject in _VAL_SUBJECTS else "train"
        positions = y_up(_places(path, 24))
        found.append(_labelled(path, path.stem, body, positions, _HUMANACT12_FPS, split, HUMANACT12[action - 1]))
    return found


def _uestc(folder: Path) -> list[LabelledPositions]:
    names, classes = (_lines(folder / "info" / name) for name in ("names.txt", "action_classes.txt"))
    body = body_of_list("vibe18")
    found = []
    for line in names:
        match = _UESTC_NAME.fullmatch(line)
        if match is None:
            raise InputError(f"{folder / 'info' / 'names.txt'} has the line {line[:80]!r}, which names no video.")
        action, view, subject, side = map(int, match.groups())
        if action >= len(classes):
            raise InputError(f"{line} is of the action {action}, but there are {len(classes)} names of actions.")
        if side != 1 and view == 8:
            continue
        path = folder / "joints3d" / f"{line.removesuffix('.avi')}.npy"
        positions = _places(path, 49)[:, _OF_VIBE]
        if side != 1:
            positions = turned_about_y(positions, np.asarray(-view * np.pi / 4))
        split = "test"
        if subject in _UESTC_TRAINING:
            split = "val" if _UESTC_TRAINING.index(subject) % 10 == 9 else "train"
        clip = line.removesuffix(".avi")
        found.append(_labelled(path, clip, body, y_up(positions), _UESTC_FPS, split, classes[action]))
    if not found:
        raise InputError(f"{folder} names no videos.", "Give the folder with info/names.txt.")
    return found


def _labelled(
    path: Path, clip: str, body: StoredBody, positions: np.ndarray, fps: float, split: str, action: str
) -> LabelledPositions:
    row = ClipRow(
        clip=clip, source=str(path), sha256=sha256_of_file(path), skeleton=body.id, frames=len(positions), fps=fps,
        seconds=len(positions) / fps, split=split, licence=_LICENCE,
    )  # fmt: skip
    return labelled_positions(row, body, positions, action)


def labelled_positions(row: ClipRow, body: StoredBody, positions: np.ndarray, action: str) -> LabelledPositions:
    """A clip of positions (T, J, 3) metres, Y up, with its scale. Raises InputError for a body without lengths."""
    return LabelledPositions(row, body, positions, scale_of_positions(body, positions), action)


def _places(path: Path, joints: int) -> np.ndarray:
    try:
        array = read_array(path.read_bytes(), str(path))
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.") from None
    if array.ndim != 3 or array.shape[1:] != (joints, 3) or not len(array) or array.dtype.kind != "f":
        raise InputError(
            f"{path} holds {array.dtype} of the shape {array.shape}, expected floats of frames, {joints} joints, 3."
        )
    if not np.isfinite(array).all():
        raise InputError(f"{path} has positions that are not finite.")
    return array.astype(np.float64)


def _lines(path: Path) -> list[str]:
    try:
        return [line.strip() for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path} cannot be read: {error}.", "Give the folder with info/names.txt.") from None
