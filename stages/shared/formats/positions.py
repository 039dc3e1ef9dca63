"""Joint positions (.npy, .npz, CSV, TRC) as motion, by inverse kinematics (`stages.shared.formats.pointing`).

Names and parents come from the file, a JSON beside it ({"names": [...], "parents": [...], "fps": 60}), a rig in BVH,
or a list of `stages.shared.formats.joint_lists`. The rig or list gives the bones' directions; lengths are measured.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from data_schemas.errors import InputError
from data_schemas.notes import Flag, Note, note
from stages.shared.formats.arrays import array_names, read_array, read_arrays
from stages.shared.formats.bvh_header_write import plain_names
from stages.shared.formats.measured_positions import MeasuredPositions, sensible_rate
from stages.shared.formats.pointing import pointed_rotations
from stages.shared.formats.positions_csv import read_csv
from stages.shared.formats.positions_rig import Frame, with_joints
from stages.shared.formats.positions_trc import read_trc
from stages.shared.formats.recording import Asked, Recording, check_room, recording_of
from stages.shared.formats.source_body import SourcePoses, SourceRig, body_of
from stages.shared.formats.table_columns import looks_trc
from stages.shared.humanoid.reference_pose import find_up_axis

USUAL_FPS = 30.0
_PLACES = ("positions", "joints", "joint_positions", "joints3d", "joints_3d", "keypoints3d", "keypoints_3d", "xyz")
_NAMES = ("names", "joint_names")
_RATES = ("fps", "framerate", "frame_rate", "mocap_framerate", "mocap_frame_rate")
_MOST_MISSING = 0.5
_LEAST_BONES = 5
_MOST_VARYING = 0.4  # of a bone's length
_MOST_RATIO = 8.0


def read_positions(data: bytes, name: str, asked: Asked) -> list[Recording]:
    """The clip of a file of positions. Raises InputError naming file and joint."""
    measured, frame = with_joints(_read_measured(data, name), name, asked)
    notes = list(measured.notes)
    check_room(name, len(data), len(measured.places), len(frame.names))
    places = _filled(measured.places, frame, name, notes)
    _check_lengths(frame, places, name)
    fps = asked.fps_override or measured.fps
    if fps is None:
        fps = USUAL_FPS
        notes.append(note(Flag.NO_FRAME_RATE, fps=USUAL_FPS))
    offsets = _measured_lengths(frame, places)
    seen = frame.column >= 0
    count = frame.rig_joints
    ends = frame.ends.copy()
    for end in range(count, len(frame.names)):
        ends[frame.parents[end]] = offsets[end]
    rig = SourceRig(
        names=frame.names[:count],
        parents=frame.parents[:count],
        offsets=tuple(map(tuple, offsets[:count].tolist())),
        end_sites=tuple(map(tuple, ends.tolist())),
        placed=tuple(joint == 0 for joint in range(count)),
        unit_m=measured.unit_m,
        usual_unit_m=dict(asked.usual_units).get(rig_key(frame.names[:count])),
        maps=asked.skeleton_maps,
    )
    try:
        body = body_of(rig)
    except InputError as error:
        raise InputError(f"{name}: {error.message}", error.hint) from None
    if rig_up := find_up_axis(
        np.zeros_like(offsets[:count]), places[:: max(1, len(places) // 64), :count], body.parts
    ):  # no pose at rest is known to stand
        rig = replace(rig, up_axis=rig_up)
    local = pointed_rotations(offsets, frame.parents, places, seen)[:, :count]
    recording = recording_of(name, rig, SourcePoses(local, places[:, 0].copy(), fps), asked, notes=notes)
    holes = ~np.isfinite(measured.places[:, frame.column[seen]]).all(axis=(1, 2))
    return [replace(recording, repaired_frames=int(holes.sum()))]


def rig_key(names: Sequence[str]) -> tuple[str, ...]:
    """The joints' names as a key of the rig, the same in any order of the joints."""
    return tuple(sorted(plain_names(names)))


# --- the file's content -------------------------------------------------------------------------


def _read_measured(data: bytes, name: str) -> MeasuredPositions:
    if data.startswith(b"PK"):
        return _of_npz(data, name)
    if data.startswith(b"\x93NUMPY"):
        return MeasuredPositions(_cube(read_array(data, name), name))
    if looks_trc(data[:4096]):
        return read_trc(data, name)
    return read_csv(data, name)


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
            fps = sensible_rate(float(arrays[each].reshape(-1)[0]), name)
    if names.dtype.kind not in "SU" or parents.dtype.kind not in "iu":
        raise InputError(f"{name}: its names must be text, and its parents whole numbers.")
    texts = [
        text.decode("utf-8", errors="replace") if isinstance(text, bytes) else str(text) for text in names.ravel()
    ]
    return MeasuredPositions(
        _cube(arrays[key], f"{name}: '{key}'"), tuple(texts), tuple(map(int, parents.ravel())), fps
    )


def _cube(array: np.ndarray, name: str) -> np.ndarray:
    """(T, J, 3) floats; a leading axis of one clip or person is dropped."""
    while array.ndim > 2 and array.shape[0] == 1 and (array.ndim > 3 or array.shape[2] != 3):
        array = array[0]
    if array.ndim == 2 and array.size and array.shape[1] % 3 == 0:
        array = array.reshape(len(array), -1, 3)
    if array.ndim != 3 or array.shape[2] != 3 or array.dtype.kind not in "iuf" or 0 in array.shape:
        raise InputError(f"{name} has the shape {array.shape}, expected frames, joints and 3.")
    return (
        array
        if array.dtype in (np.float32, np.float64)
        else array.astype(np.float32 if array.itemsize < 4 else float)
    )


# --- numbers ------------------------------------------------------------------------------------


def _filled(places: np.ndarray, frame: Frame, name: str, notes: list[Note]) -> np.ndarray:
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


def _bones(frame: Frame, places: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Each joint that is measured as its parent is, with the distance between the two in every frame."""
    for joint, parent in enumerate(frame.parents):
        if parent >= 0 and frame.column[joint] >= 0 and frame.column[parent] >= 0:
            yield joint, np.linalg.norm(places[:, joint] - places[:, parent], axis=1)


def _check_lengths(frame: Frame, places: np.ndarray, name: str) -> None:
    """Refuse numbers that are not places: lengths of bones that vary, or that differ too much from the rig's.

    Angles read as places give bones whose lengths vary by about their own size (a walk: 95% between the 5th and the
    95th percentile); places that cameras measured vary by 2 to 16%.
    """
    sizes = np.linalg.norm(frame.rest, axis=1)
    varying, ratios = [], []
    for joint, lengths in _bones(frame, places):
        usual = float(np.median(lengths))
        low, high = np.percentile(lengths, [5, 95])
        varying.append((high - low) / usual if usual > 0 else 0.0)
        if usual > 0 and sizes[joint] > 0:
            ratios.append(usual / sizes[joint])
    hint = "Are they angles or velocities? Give the places of joints, or the motion as BVH or GLB."
    if len(varying) >= _LEAST_BONES and np.median(varying) > _MOST_VARYING:
        raise InputError(
            f"{name}: the bones between its joints change their length by {np.median(varying):.0%} (median over"
            f" {len(varying)} bones), so its numbers are not places of joints.",
            hint,
        )
    if frame.proportions and len(ratios) >= _LEAST_BONES:
        low, high = np.percentile(ratios, [10, 90])
        if high > _MOST_RATIO * low:
            raise InputError(
                f"{name}: against the skeleton's bones the measured ones are {low:.2g} to {high:.2g} times as long,"
                " so its numbers are not places of these joints.",
                hint,
            )


def _measured_lengths(frame: Frame, places: np.ndarray) -> np.ndarray:
    """(J, 3) rest directions with the measured lengths, rounded to at most 1/10,000 of the sum of all lengths.

    Bones without measurements are scaled by the median ratio of measured lengths to the rig's lengths.
    """
    sizes = np.linalg.norm(frame.rest, axis=1)
    lengths = np.zeros(len(sizes))
    for joint, measured in _bones(frame, places):
        lengths[joint] = measured.mean()
    sized = (lengths > 0) & (sizes > 0)
    ratio = float(np.median(lengths[sized] / sizes[sized])) if sized.any() else 1.0
    if not lengths.sum() > 0:
        return frame.rest * ratio
    step = 10.0 ** np.floor(np.log10(lengths.sum())) / 10_000
    wanted = np.where(lengths > 0, np.round(lengths / step) * step, sizes * ratio)
    offsets = frame.rest * np.divide(wanted, sizes, out=np.zeros_like(sizes), where=sizes > 0)[:, None]
    offsets[0] = 0.0
    return offsets
