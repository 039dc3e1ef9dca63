"""Reading SMPL, SMPL-H and SMPL-X pose vectors from .npz: AMASS' old and new layout, and the smplx package's names.

AMASS' world is Z up; others' may be Y up, and no file states which. The body's poses show it: see `_standing_axis`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from data_schemas.errors import InputError
from data_schemas.notes import Flag, Note, note
from stages.shared.formats.arrays import read_arrays
from stages.shared.formats.recording import MAX_JOINTS, Asked, Recording, check_room, recording_of
from stages.shared.formats.smpl import GENDERS, LAYOUTS, RestJoints, neutral_joints, parents_of, subject_joints
from stages.shared.formats.smpl_keys import PLACE_NAMES, POSE_NAMES, names_smplx, places_of, pose_vectors
from stages.shared.formats.source_body import SourcePoses, SourceRig, body_of
from stages.shared.humanoid.reference_pose import standing_axis_of_poses
from stages.shared.kinematics.forward_numpy import global_rotations, joint_positions

_RATES = ("mocap_framerate", "mocap_frame_rate", "framerate", "frame_rate", "fps")
_Place = tuple[float, float, float]
_USUAL_FPS = 30.0
_LOOKED_AT = 64  # poses from which the up axis is found
_RIG = ("joint_names", "parents", "offsets")
_WANTED = ("gender", "betas", *POSE_NAMES, *PLACE_NAMES, *_RATES, *_RIG, "ends")
_BLOCK = 4096  # frames
_LAYOUT_OF = {3 * len(names): layout for layout, names in LAYOUTS.items()}


def read_amass(data: bytes, name: str, asked: Asked) -> list[Recording]:
    """The clip of a file of SMPL's parameters. Raises InputError naming the file and the key."""
    arrays, pickled = read_arrays(data, name, _WANTED)
    given = {key: values for key in POSE_NAMES if (values := _numbers(arrays, key, name)) is not None}
    vectors, notes = pose_vectors(given, name)
    frames = len(vectors)
    own = _own_rig(arrays, name, vectors.shape[1])
    layout = _LAYOUT_OF.get(vectors.shape[1])
    if own is None and layout is None:
        widths = ", ".join(f"{width} ({kind})" for width, kind in sorted(_LAYOUT_OF.items()))
        raise InputError(f"{name}: its poses are {vectors.shape[1]} numbers wide; pumps reads widths of {widths}.")
    trans = _path_of(arrays, frames, name)
    if trans is None:
        notes.append(note(Flag.NO_TRANSLATION))
        trans = np.zeros((frames, 3))
    if own is not None:
        rig, pelvis, remarks = own, (0.0, 0.0, 0.0), []
    else:
        assert layout is not None
        rest, remarks = _rest_joints(arrays, pickled, name, layout, asked)
        ends = ((0.0, 0.0, 0.0),) * len(rest.offsets)
        rig, pelvis = _rig(LAYOUTS[layout], parents_of(layout), rest.offsets, ends), rest.pelvis
    check_room(name, len(data), frames, len(rig.names))
    fps = asked.fps_override or _rate(arrays, name)
    if fps is None:
        fps = _USUAL_FPS
        remarks = [*remarks, note(Flag.NO_FRAME_RATE, fps=fps)]
    # The model turns about the pelvis where it stands at rest, then moves by trans.
    poses = SourcePoses(_quaternions(vectors), trans + np.array(pelvis), fps)
    if not all(key in arrays for key in _RIG):  # the files that pumps writes are Z up
        usual = "y" if names_smplx(arrays) else "z"
        found = _standing_axis(rig, poses)
        rig = replace(rig, up_axis=found or usual)
        if asked.up_axis is None and (rig.up_axis != "z" or usual != "z"):
            remarks = [*remarks, note(Flag.UP_FROM_MOTION, up_axis=rig.up_axis, stands=found is not None)]
    return [recording_of(name, rig, poses, asked, notes=notes, remarks=remarks)]


@dataclass(frozen=True)
class SmplParameters:
    """A recording as a body model's parameters.

    layout: of its joints, a key of LAYOUTS. vectors: (T, 3 J) rotation vectors in the parents' frames, radians.
    trans: (T, 3) metres. fps: as stated, else 30. betas: (B,) of the shape. gender: None if not stated.
    up_axis: of its world, "y" or "z".
    """

    layout: str
    vectors: np.ndarray
    trans: np.ndarray
    fps: float
    betas: np.ndarray
    gender: str | None
    up_axis: str


def smpl_parameters(data: bytes, name: str) -> SmplParameters:
    """The parameters of a file. Raises InputError naming the file and the key; also for a rig that is not SMPL's."""
    arrays, _ = read_arrays(data, name, _WANTED)
    given = {key: values for key in POSE_NAMES if (values := _numbers(arrays, key, name)) is not None}
    vectors, _ = pose_vectors(given, name)
    layout = _LAYOUT_OF.get(vectors.shape[1])
    if layout is None or _own_rig(arrays, name, vectors.shape[1]) is not None:
        raise InputError(f"{name} holds no parameters of SMPL, SMPL-H or SMPL-X, but those of another rig.")
    trans = _path_of(arrays, len(vectors), name)
    trans = np.zeros((len(vectors), 3)) if trans is None else trans
    fps = _rate(arrays, name) or _USUAL_FPS
    rest = neutral_joints(layout)
    rig = _rig(LAYOUTS[layout], parents_of(layout), rest.offsets, ((0.0, 0.0, 0.0),) * len(rest.offsets))
    found = _standing_axis(rig, SourcePoses(_quaternions(vectors), trans, fps))
    betas = _betas(arrays, name)
    return SmplParameters(
        layout, vectors, trans, fps, np.zeros(0) if betas is None else betas, _gender(arrays),
        found or ("y" if names_smplx(arrays) else "z"),
    )  # fmt: skip


def _path_of(arrays: dict[str, np.ndarray], frames: int, name: str) -> np.ndarray | None:
    """(T, 3) places, None if the file has none. Raises InputError for another shape."""
    key = next((key for key in PLACE_NAMES if key in arrays), PLACE_NAMES[0])
    trans = _numbers(arrays, key, name)
    if trans is None:
        return None
    trans = places_of(trans)
    if trans.shape != (frames, 3):
        raise InputError(f"{name}: {key} has the shape {trans.shape}, expected {(frames, 3)}.")
    return trans


def _standing_axis(rig: SourceRig, poses: SourcePoses) -> str | None:
    """The axis, "y" or "z", along which the body stands in its poses; None if it stands along neither."""
    body = body_of(rig)
    seen = np.unique(np.linspace(0, len(poses.local) - 1, _LOOKED_AT).astype(int))
    rotations = global_rotations(poses.local[seen].astype(np.float64), body.parents)
    heads = joint_positions(rotations, poses.root[seen], body.offsets, body.parents)
    return standing_axis_of_poses(heads, body.parts)


def _rig(
    names: tuple[str, ...], parents: tuple[int, ...], offsets: tuple[_Place, ...], ends: tuple[_Place, ...]
) -> SourceRig:
    placed = tuple(joint == 0 for joint in range(len(names)))
    return SourceRig(names, parents, offsets, ends, placed, unit_m=1.0, up_axis="z")


def _own_rig(arrays: dict[str, np.ndarray], name: str, width: int) -> SourceRig | None:
    """The rig stored in an AMASS-like file (see `stages.shared.formats.amass_write`); None for a rig of SMPL.

    Raises: InputError if its joints do not match its poses.
    """
    if not all(key in arrays for key in _RIG):
        return None
    names = tuple(str(joint) for joint in arrays["joint_names"].reshape(-1).tolist())
    if names == LAYOUTS.get(_LAYOUT_OF.get(width, "")):
        return None
    joints = len(names)
    offsets, ends = _numbers(arrays, "offsets", name), _numbers(arrays, "ends", name)
    ends = np.zeros((joints, 3)) if ends is None else ends
    parents = arrays["parents"]
    sizes = (width, None if offsets is None else offsets.shape, ends.shape, parents.shape)
    if sizes != (3 * joints, (joints, 3), (joints, 3), (joints,)) or parents.dtype.kind not in "iu" or joints == 0:
        raise InputError(f"{name}: joint_names, parents, offsets and poses differ in their number of joints.")
    if joints > MAX_JOINTS or parents[0] != -1 or ((parents[1:] < 0) | (parents[1:] >= np.arange(1, joints))).any():
        raise InputError(f"{name}: parents must form one tree, with every parent before its children.")
    assert offsets is not None
    return _rig(names, tuple(parents.tolist()), _places(offsets), _places(ends))


def _places(rows: np.ndarray) -> tuple[_Place, ...]:
    return tuple((x, y, z) for x, y, z in rows.tolist())


def _quaternions(vectors: np.ndarray) -> np.ndarray:
    """(T, J, 4) float32 quaternions of rotation vectors (T, 3 J), computed in blocks of frames."""
    out = np.empty((len(vectors), vectors.shape[1] // 3, 4), np.float32)
    for start in range(0, len(vectors), _BLOCK):
        block = vectors[start : start + _BLOCK].astype(np.float64)
        out[start : start + _BLOCK] = Rotation.from_rotvec(block.reshape(-1, 3)).as_quat().reshape(len(block), -1, 4)
    return out


def _numbers(arrays: dict[str, np.ndarray], key: str, name: str) -> np.ndarray | None:
    """An array of finite numbers as floats; None if it is missing. Raises InputError for any other array."""
    array = arrays.get(key)
    if array is None:
        return None
    if array.dtype.kind not in "biuf":
        raise InputError(f"{name}: {key} holds no numbers.")
    values = array if array.dtype in (np.float32, np.float64) else array.astype(np.float32)
    finite = np.isfinite(values)
    if not finite.all():
        where = f" in frame {np.argwhere(~finite)[0][0]}" if values.ndim > 1 else ""
        raise InputError(f"{name}: {key} is not finite{where}.")
    if values.size and max(values.max(), -values.min()) > 1e6:
        raise InputError(
            f"{name}: {key} holds {max(values.max(), -values.min()):.3g}, which is too large for an angle or a place."
        )
    return values


def _rate(arrays: dict[str, np.ndarray], name: str) -> float | None:
    """The stated rate; None for the smplx package's parameters, which have none."""
    for key in _RATES:
        values = _numbers(arrays, key, name)
        if values is not None and values.size == 1:
            fps = float(values.reshape(-1)[0])
            if 0.1 <= fps <= 10_000:
                return fps
            raise InputError(f"{name}: {key} is {fps:g} frames a second.", "Give the true rate with --fps-override.")
    if names_smplx(arrays):
        return None
    raise InputError(f"{name} has no mocap_framerate.", "Give the rate with --fps-override '*=120'.")


def _rest_joints(
    arrays: dict[str, np.ndarray], pickled: list[str], name: str, layout: str, asked: Asked
) -> tuple[RestJoints, list[Note]]:
    """The skeleton, and the assumptions made for it."""
    if asked.body_models is None:
        return neutral_joints(layout), [note(Flag.NEUTRAL_BODY)]
    remarks = []
    gender = _gender(arrays)
    if gender is None:
        gender = "neutral"
        remarks.append(note(Flag.NO_GENDER, pickled="gender" in pickled))
    betas = _betas(arrays, name)
    if betas is None:
        betas = np.zeros(0)
        remarks.append(note(Flag.MEAN_BODY))
    try:
        return subject_joints(asked.body_models, layout, gender, betas), remarks
    except InputError as error:
        raise InputError(f"{name}: {error.message}", error.hint) from None


def _betas(arrays: dict[str, np.ndarray], name: str) -> np.ndarray | None:
    """(B,) shape parameters, None if the file has none. Raises InputError for another shape."""
    betas = _numbers(arrays, "betas", name)
    if betas is None:
        return None
    if betas.ndim == 2:
        betas = betas.mean(axis=0)  # one set per frame, all equal
    if betas.ndim != 1:
        raise InputError(f"{name}: betas has the shape {betas.shape}, expected one row.")
    return betas


def _gender(arrays: dict[str, np.ndarray]) -> str | None:
    """ "male", "female" or "neutral", however it is spelt: text, bytes, text of bytes ("b'male'"), a letter."""
    array = arrays.get("gender")
    if array is None or array.dtype.kind not in "SU" or array.size != 1:
        return None
    word = array.reshape(-1)[0]
    text = word.decode("latin-1") if isinstance(word, bytes) else str(word)
    text = text.strip().lower().removeprefix("b'").removesuffix("'")
    return next((gender for gender in GENDERS if text and gender.startswith(text)), None)
