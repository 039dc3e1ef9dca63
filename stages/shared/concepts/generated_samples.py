"""Motions that the authors of Action2Motion (Guo et al. 2020) published as their generators' output.

The folder of one generator holds `label_enc_rev_*.txt`, a line `(0, 'Walk')` for each class, and in `joints/` a
file `motion_joints*.npy`, (N, T, 3 J) float positions, beside `motion_class.npy`, (N,) int classes. The name of the
list of classes says which data set was learned, and so the joints, their axes, the rate, and what classes are called.
No file states the rates; they are those of the data sets as Action2Motion prepared them: 20, 12 and 30 a second.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path, PurePosixPath

import numpy as np

from data_schemas.clips import ClipRow
from data_schemas.concepts import StoredBody
from data_schemas.errors import InputError
from stages.shared.concepts.actions import HUMANACT12
from stages.shared.concepts.body_positions import STATURE_M
from stages.shared.concepts.data_sets import (
    LabelledPositions,
    body_of_joints,
    body_of_list,
    labelled_positions,
    y_up,
)
from stages.shared.formats.archives import archive_and_member, archive_suffix, members_of
from stages.shared.formats.arrays import read_array
from stages.shared.formats.sources import source_named

_MOST_SCALE = 2.5  # the files of the generators of Lie algebra do not hold positions in metres
LICENCE = "MIT, Copyright (c) 2022 Chuan Guo"
_MOCAP_NAMES = (
    "hips", "spine", "neck", "head", "left_shoulder", "left_elbow", "left_wrist", "left_hand", "right_shoulder",
    "right_elbow", "right_wrist", "right_hand", "left_hip", "left_knee", "left_ankle", "left_foot", "right_hip",
    "right_knee", "right_ankle", "right_foot",
)  # fmt: skip
_MOCAP_PARENTS = (-1, 0, 1, 2, 1, 4, 5, 6, 1, 8, 9, 10, 0, 12, 13, 14, 0, 16, 17, 18)


@dataclass(frozen=True)
class _Learned:
    """A data set that a generator learned. body: of its joints; fps: of its motions; y_down: whether their axes are a
    camera's; action: the name of a class from the text in the list of classes."""

    body: Callable[[], StoredBody]
    fps: float
    y_down: bool
    action: Callable[[str], str]


def _humanact12_action(text: str) -> str:
    number = int(text) if text.isdecimal() and len(text) <= 4 else 0
    if not 1 <= number <= len(HUMANACT12):
        raise InputError(f"HumanAct12 has no action {text[:40]!r}, only 1 to {len(HUMANACT12)}.")
    return HUMANACT12[number - 1]


_LEARNED = {
    "label_enc_rev_humanact12.txt": _Learned(lambda: body_of_list("smpl24"), 20.0, True, _humanact12_action),
    "label_enc_rev_mocap.txt": _Learned(
        lambda: body_of_joints(_MOCAP_NAMES, _MOCAP_PARENTS), 12.0, False,
        lambda text: text.lower().replace(" ", "_"),
    ),
    "label_enc_rev_ntu_vibe.txt": _Learned(lambda: body_of_list("vibe18"), 30.0, True, lambda text: f"ntu_{text}"),
}  # fmt: skip


def positions_of_samples(given: Path) -> list[LabelledPositions]:
    """The motions of one generator, all of the split `test`.

    Args:
        given: its folder, or ARCHIVE!FOLDER.

    Raises: InputError naming the file that is missing or bad, or the generators where several are given.
    """
    files = _files(given)
    lists = sorted(name for name in files if PurePosixPath(name).name in _LEARNED)
    if len(lists) != 1:
        named = ", ".join(str(PurePosixPath(name).parent) for name in lists)
        raise InputError(
            f"{given} holds {f'{len(lists)} generators: {named}' if lists else 'no label_enc_rev_*.txt'}.",
            "Give the folder of one, such as FILE.zip!action2motion-samples/humanact12/vanila_vae_tf.",
        )
    learned = _LEARNED[PurePosixPath(lists[0]).name]
    classes = _classes(source_named(files[lists[0]]).read(), f"{given}: {lists[0]}")
    joints = [name for name in files if PurePosixPath(name).name.startswith("motion_joints")]
    numbers = [name for name in files if PurePosixPath(name).name == "motion_class.npy"]
    if len(joints) != 1 or len(numbers) != 1:
        raise InputError(f"{given} holds no joints/motion_joints*.npy beside a motion_class.npy, or several of them.")
    body = learned.body()
    data = source_named(files[joints[0]]).read()
    places = _places(read_array(data, joints[0]), len(body.names), f"{given}: {joints[0]}")
    of_motion = read_array(source_named(files[numbers[0]]).read(), numbers[0])
    if of_motion.shape != (len(places),) or of_motion.dtype.kind not in "iu":
        raise InputError(f"{given}: {numbers[0]} does not hold one class for each of {len(places)} motions.")
    digest, found = sha256(data).hexdigest(), []
    for number, (positions, kind) in enumerate(zip(places, of_motion.tolist(), strict=True)):
        if kind not in classes:
            raise InputError(f"{given}: motion {number} is of the class {kind}, which {lists[0]} does not name.")
        row = ClipRow(
            clip=f"sample_{number:03d}", source=f"{given}", sha256=digest, skeleton=body.id, frames=len(positions),
            fps=learned.fps, seconds=len(positions) / learned.fps, split="test", licence=LICENCE,
        )  # fmt: skip
        turned = y_up(positions) if learned.y_down else positions
        clip = labelled_positions(row, body, turned, learned.action(classes[kind]))
        if not 1 / _MOST_SCALE < clip.scale < _MOST_SCALE:
            raise InputError(
                f"{given}: {joints[0]} holds bodies of {STATURE_M / clip.scale:.1f} m up to the head's joint, so its "
                "numbers are no joints in metres.",
                "Give another generator's folder.",
            )
        found.append(clip)
    return found


def _files(given: Path) -> dict[str, str]:
    """The source's name of each file, by its path below the folder or inside the archive."""
    archive, inside = archive_and_member(str(given))
    archive = archive or str(given)
    if inside or archive_suffix(archive):
        prefix = f"{inside.strip('/')}/" if inside.strip("/") else ""
        return {
            member.name: f"{archive}!{member.name}"
            for member in members_of(archive)
            if member.name.startswith(prefix)
        }
    if not given.is_dir():
        raise InputError(f"{given} is not a folder.", "Give the folder of one generator's output.")
    paths = [path for pattern in ("*.txt", "*.npy", "*/*.txt", "*/*.npy") for path in given.glob(pattern)]
    return {path.relative_to(given).as_posix(): str(path) for path in paths}


def _classes(data: bytes, name: str) -> dict[int, str]:
    """The classes' texts by number, of lines such as `(0, 'Walk')`."""
    found = {}
    for line in data[: 1 << 16].decode("utf-8", errors="replace").splitlines():
        if line.strip():
            try:
                number, text = ast.literal_eval(line.strip())
                found[int(number)] = str(text)
            except (ValueError, TypeError, SyntaxError, OverflowError, MemoryError, RecursionError):
                raise InputError(f"{name} has the line {line[:60]!r}, expected one like (0, 'Walk').") from None
    return found


def _places(array: np.ndarray, joints: int, name: str) -> np.ndarray:
    """(N, T, J, 3) float64 of an array (N, T, 3 J)."""
    if array.ndim != 3 or array.shape[2] != 3 * joints or array.dtype.kind != "f" or not array.size:
        raise InputError(
            f"{name} holds {array.dtype} of the shape {array.shape}, expected motions, frames, {3 * joints}."
        )
    if not np.isfinite(array).all():
        raise InputError(f"{name} has positions that are not finite.")
    return array.astype(np.float64).reshape(*array.shape[:2], joints, 3)
