"""Joint positions (.npy, .npz, CSV) as motion, by inverse kinematics (`stages.shared.formats.pointing`).

Names and parents come from the file, a JSON beside it ({"names": [...], "parents": [...], "fps": 60}), a rig in BVH,
or a list of `stages.shared.formats.joint_lists`. The rig or list gives the bones' directions; lengths are measured.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from data_schemas.errors import InputError
from data_schemas.notes import Flag, Note, note
from stages.shared.formats.arrays import array_names, read_array, read_arrays
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.joint_lists import LISTS
from stages.shared.formats.pointing import pointed_rotations
from stages.shared.formats.positions_csv import read_csv
from stages.shared.formats.recording import MAX_JOINTS, Asked, Recording, check_room, recording_of
from stages.shared.formats.source_body import SourcePoses, SourceRig, body_of
from stages.shared.humanoid.reference_pose import find_up_axis

USUAL_FPS = 30.0
_PLACES = ("positions", "joints", "joint_positions", "joints3d", "joints_3d", "keypoints3d", "keypoints_3d", "xyz")
_NAMES = ("names", "joint_names")
_RATES = ("fps", "framerate", "frame_rate", "mocap_framerate", "mocap_frame_rate")
_MOST_MISSING = 0.5


@dataclass(frozen=True)
class MeasuredPositions:
    """places: (T, J, 3), NaN where missing. names, parents: J of them, or empty. fps: None if not stated."""

    places: np.ndarray
    names: tuple[str, ...] = ()
    parents: tuple[int, ...] = ()
    fps: float | None = None


@dataclass(frozen=True)
class _Frame:
    """The joints to point. rest: (J, 3) in the parents' frames. column: (J,) index of the measured joint, or -1."""

    names: tuple[str, ...]
    parents: tuple[int, ...]
    rest: np.ndarray
    column: np.ndarray
    ends: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))


def read_positions(data: bytes, name: str, asked: Asked) -> list[Recording]:
    """The clip of a file of positions. Raises InputError naming file and joint."""
    measured = _read_measured(data, name)
    measured, frame = _with_joints(measured, name, asked)
    notes: list[Note] = []
    check_room(name, len(data), len(measured.places), len(frame.names))
    places = _filled(measured.places, frame, name, notes)
    fps = asked.fps_override or measured.fps
    if fps is None:
        fps = USUAL_FPS
        notes.append(note(Flag.NO_FRAME_RATE, fps=USUAL_FPS))
    offsets = _measured_lengths(frame, places)
    seen = frame.column >= 0
    ends = frame.ends if len(frame.ends) else np.zeros_like(offsets)
    rig = SourceRig(
        names=frame.names,
        parents=frame.parents,
        offsets=tuple(map(tuple, offsets.tolist())),
        end_sites=tuple(map(tuple, ends.tolist())),
        placed=tuple(joint == 0 for joint in range(len(frame.names))),
        maps=asked.skeleton_maps,
    )
    try:
        body = body_of(rig)
    except InputError as error:
        raise InputError(f"{name}: {error.message}", error.hint) from None
    if rig_up := find_up_axis(
        np.zeros_like(offsets), places[:: max(1, len(places) // 64)], body.parts
    ):  # no pose at rest is known to stand
        rig = replace(rig, up_axis=rig_up)
    local = pointed_rotations(offsets, frame.parents, places, seen)
    recording = recording_of(name, rig, SourcePoses(local, places[:, 0].copy(), fps), asked, notes=notes)
    holes = ~np.isfinite(measured.places[:, frame.column[seen]]).all(axis=(1, 2))
    return [replace(recording, repaired_frames=int(holes.sum()))]


# --- the file's content -------------------------------------------------------------------------


def _read_measured(data: bytes, name: str) -> MeasuredPositions:
    if data.startswith(b"PK"):
        return _of_npz(data, name)
    if data.startswith(b"\x93NUMPY"):
        return MeasuredPositions(_cube(read_array(data, name), name))
    names, places, fps = read_csv(data, name)
    return MeasuredPositions(places, names, fps=fps)


def _of_npz(data: bytes, name: str) -> MeasuredPositions:
    listed = array_names(data, name)
    key = next((key for key in _PLACES if key in listed), None)
    key = key or next((key for key in listed if key not in (*_NAMES, *_RATES, "parents")), None)
    if key is None:
        raise InputError(f"{name} holds no array of positions.", f"Call it one of {', '.join(_PLACES)}.")
    arrays, _ = read_arrays(data, name, (key, *_NAMES, *_RATES, "parents"))
    if key not in arrays:
        raise InputError(f"{name}: its array '{key}' is pickled.", "Save it as plain numbers.")
    names = next((arrays[each] for each in _NAMES if each in arrays), np.array([], "U1"))
    parents = arrays.get("parents", np.array([], int))
    fps = None
    for each in _RATES:
        if each in arrays and arrays[each].size == 1 and arrays[each].dtype.kind in "iuf":
            fps = _sensible_rate(float(arrays[each].reshape(-1)[0]), name)
    if names.dtype.kind not in "SU" or parents.dtype.kind not in "iu":
        raise InputError(f"{name}: its names must be text, and its parents whole numbers.")
    texts = [
        text.decode("utf-8", errors="replace") if isinstance(text, bytes) else str(text) for text in names.ravel()
    ]
    return MeasuredPositions(
        _cube(arrays[key], f"{name}: '{key}'"), tuple(texts), tuple(map(int, parents.ravel())), fps
    )


def _cube(array: np.ndarray, name: str) -> np.ndarray:
    """(T, J, 3) floats."""
    if array.ndim == 2 and array.size and array.shape[1] % 3 == 0:
        array = array.reshape(len(array), -1, 3)
    if array.ndim != 3 or array.shape[2] != 3 or array.dtype.kind not in "iuf" or 0 in array.shape:
        raise InputError(f"{name} has the shape {array.shape}, expected frames, joints and 3.")
    return (
        array
        if array.dtype in (np.float32, np.float64)
        else array.astype(np.float32 if array.itemsize < 4 else float)
    )


def _sensible_rate(fps: float, name: str) -> float:
    if not 0.1 <= fps <= 10_000:
        raise InputError(f"{name}: its rate is {fps:g} frames a second.", "Give the true rate with --fps-override.")
    return fps


# --- which joints they are ----------------------------------------------------------------------


def _with_joints(measured: MeasuredPositions, name: str, asked: Asked) -> tuple[MeasuredPositions, _Frame]:
    count = measured.places.shape[1]
    if count > MAX_JOINTS:
        raise InputError(f"{name} has {count} joints, and {MAX_JOINTS} are the most.")
    if asked.rig and b"HIERARCHY" in asked.rig[:4096].upper():
        return measured, _on_rig(measured, name, asked)
    if asked.rig:
        measured = _with_sidecar(measured, asked)
    listed = asked.rig_name if asked.rig_name in LISTS else None
    if listed is None and not measured.parents:
        listed = _list_of(measured.names)
    if listed is not None:
        return measured, _on_list(measured, name, listed)
    if not measured.names or not measured.parents:
        raise InputError(
            f"{name} states no joint names and parents.",
            f"Give --skeleton a rig (BVH) or one of {', '.join(LISTS)}, or put a JSON beside it (docs/formats.md).",
        )
    return measured, _on_own(measured, name)


def _with_sidecar(measured: MeasuredPositions, asked: Asked) -> MeasuredPositions:
    try:
        raw = json.loads(asked.rig) if len(asked.rig) < 4 << 20 else None
        names = tuple(str(each) for each in raw.get("names", measured.names))  # type: ignore[union-attr]
        parents = tuple(int(each) for each in raw.get("parents", measured.parents))  # type: ignore[union-attr]
        fps = measured.fps if raw.get("fps") is None else float(raw["fps"])  # type: ignore[index, union-attr]
    except (ValueError, TypeError, AttributeError, RecursionError, OverflowError):
        raise InputError(
            f"{asked.rig_name} states no skeleton.", 'It must hold {"names": [...], "parents": [...], "fps": 60}.'
        ) from None
    return MeasuredPositions(
        measured.places, names, parents, None if fps is None else _sensible_rate(fps, asked.rig_name)
    )


def _plain(name: str) -> str:
    return name.rsplit(":", 1)[-1].strip().lower().replace(" ", "").replace("_", "")


def _list_of(names: Sequence[str]) -> str | None:
    """The list of `joint_lists` that has these joints, by their names."""
    given = {_plain(name) for name in names}
    for title, joints in LISTS.items():
        if given and given == {_plain(name) for name, *_ in joints()}:
            return title
    return None


def _on_list(measured: MeasuredPositions, name: str, title: str) -> _Frame:
    joints = LISTS[title]()
    names = [joint for joint, *_ in joints]
    columns = _columns(names, measured, name, f"the list {title}")
    parents = [names.index(parent) if parent else -1 for _, parent, _ in joints]
    return _ordered(names, parents, np.array([direction for *_, direction in joints]), columns, name)


def _on_rig(measured: MeasuredPositions, name: str, asked: Asked) -> _Frame:
    rig = read_bvh(asked.rig, asked.rig_name, keep_unreadable_rows=True)
    names = [joint.name for joint in rig.joints]
    columns = _columns(names, measured, name, asked.rig_name)
    ends = np.array([joint.end_site or (0.0, 0.0, 0.0) for joint in rig.joints])
    rest = np.array([joint.offset for joint in rig.joints])
    return _ordered(names, [joint.parent for joint in rig.joints], rest, columns, name, ends)


def _on_own(measured: MeasuredPositions, name: str) -> _Frame:
    """Joints from names and parents alone: the first frame with all joints is the pose at rest."""
    count = measured.places.shape[1]
    if len(measured.names) != count or len(measured.parents) != count:
        raise InputError(
            f"{name} has {count} joints, {len(measured.names)} names and {len(measured.parents)} parents."
        )
    if any(not -1 <= parent < count for parent in measured.parents):
        raise InputError(f"{name}: a parent is not one of its {count} joints.", "The root's parent is -1.")
    whole = np.isfinite(measured.places).all(axis=(1, 2))
    pose = measured.places[int(whole.argmax())]
    rest = pose - pose[list(measured.parents)]
    return _ordered(list(measured.names), list(measured.parents), rest, np.arange(count), name)


def _columns(names: Sequence[str], measured: MeasuredPositions, name: str, where: str) -> np.ndarray:
    """For each joint of a skeleton the index of its measured joint; -1 for none."""
    count = measured.places.shape[1]
    if not measured.names:
        if count != len(names):
            raise InputError(f"{name} has {count} joints without names, but {where} has {len(names)}.")
        return np.arange(count)
    if len(measured.names) != count:
        raise InputError(f"{name} has {count} joints but {len(measured.names)} names.")
    places = {_plain(joint): index for index, joint in enumerate(names)}
    columns = np.full(len(names), -1)
    for column, joint in enumerate(measured.names):
        if _plain(joint) not in places:
            raise InputError(
                f"{name}: {where} has no joint '{joint[:60]}'.", "Give its columns the skeleton's joint names."
            )
        columns[places[_plain(joint)]] = column
    return columns


def _ordered(
    names: Sequence[str],
    parents: Sequence[int],
    rest: np.ndarray,
    columns: np.ndarray,
    name: str,
    ends: np.ndarray | None = None,
) -> _Frame:
    """The joints, parents first, without those above the topmost measured joint."""
    children: dict[int, list[int]] = {}
    for joint, parent in enumerate(parents):
        children.setdefault(parent, []).append(joint)
    order: list[int] = []
    waiting = children.get(-1, [])[::-1]
    if len(waiting) != 1:
        raise InputError(f"{name}: there are {len(waiting)} roots among the joints, expected one.")
    while waiting:
        joint = waiting.pop()
        order.append(joint)
        waiting += children.get(joint, [])[::-1]
    if len(order) != len(names):
        raise InputError(f"{name}: the parents form a cycle.")
    while columns[order[0]] < 0:  # a root that is not measured is dropped; its one child becomes the root
        if len(children.get(order[0], [])) != 1:
            raise InputError(f"{name}: '{names[order[0]]}', the parent of several joints, is not measured.")
        order = order[1:]
    place = {joint: index for index, joint in enumerate(order)}
    return _Frame(
        names=tuple(names[joint] for joint in order),
        parents=tuple(place.get(parents[joint], -1) for joint in order),
        rest=rest[order],
        column=columns[order],
        ends=ends[order] if ends is not None else np.zeros((0, 3)),
    )


# --- numbers ------------------------------------------------------------------------------------


def _filled(places: np.ndarray, frame: _Frame, name: str, notes: list[Note]) -> np.ndarray:
    """(T, J, 3) places of the frame's joints: gaps interpolated linearly, zeros for joints without measurements."""
    out = np.zeros((len(places), len(frame.names), 3), places.dtype)
    missing = 0
    times = np.arange(len(places))
    for joint, column in enumerate(frame.column):
        if column < 0:
            continue
        track = places[:, column]
        known = np.isfinite(track).all(axis=1)
        if known.mean() < 1 - _MOST_MISSING:
            raise InputError(
                f"{name}: joint '{frame.names[joint]}' is missing in {(~known).sum()} of {len(places)} frames."
            )
        if np.abs(track[known]).max() > 1e7:
            raise InputError(
                f"{name}: joint '{frame.names[joint]}' is at {np.abs(track[known]).max():.3g}, which is too far away."
            )
        missing += int((~known).sum())
        if known.all():
            out[:, joint] = track
        else:
            out[:, joint] = np.stack([np.interp(times, times[known], track[known, i]) for i in range(3)], axis=1)
    if missing:
        notes.append(note(Flag.PLACES_INTERPOLATED, places=missing))
    return out


def _measured_lengths(frame: _Frame, places: np.ndarray) -> np.ndarray:
    """(J, 3) rest directions with the measured lengths, rounded to at most 1/10,000 of the sum of all lengths.

    Bones without measurements are scaled by the median ratio of measured lengths to the rig's lengths.
    """
    sizes = np.linalg.norm(frame.rest, axis=1)
    lengths = np.zeros(len(sizes))
    for joint, parent in enumerate(frame.parents):
        if parent >= 0 and frame.column[joint] >= 0 and frame.column[parent] >= 0:
            lengths[joint] = np.linalg.norm(places[:, joint] - places[:, parent], axis=1).mean()
    sized = (lengths > 0) & (sizes > 0)
    ratio = float(np.median(lengths[sized] / sizes[sized])) if sized.any() else 1.0
    if not lengths.sum() > 0:
        return frame.rest * ratio
    step = 10.0 ** np.floor(np.log10(lengths.sum())) / 10_000
    wanted = np.where(lengths > 0, np.round(lengths / step) * step, sizes * ratio)
    offsets = frame.rest * np.divide(wanted, sizes, out=np.zeros_like(sizes), where=sizes > 0)[:, None]
    offsets[0] = 0.0
    return offsets
