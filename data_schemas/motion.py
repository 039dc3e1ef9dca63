"""The `motion` artefact: motions on their skeletons.

`motions.h5`:
    /skeletons/<id>  names, parents, offsets, tails, groups, sampled; attributes root, unit_m, up_axis; header (bytes)
    /clips/<clip>    rotations (T, J, 4) float32 global xyzw; root_positions (T, 3) float32 metres;
                     track_joints (K,) int32; tracks (T, K, 3) float32 metres; attributes skeleton, fps
`clips.parquet`: one ClipRow a clip.
"""

from __future__ import annotations

import hashlib
import json
import os

import h5py
import numpy as np

from data_schemas.clips import ClipReader, ClipRow, ClipWriter, read_clips, write_clips
from data_schemas.damaged_files import reading
from data_schemas.errors import InputError
from data_schemas.hdf5_arrays import (
    are_unit,
    fault_of_arrays,
    group_in,
    read_frames,
    read_text,
    read_whole,
    write_frames,
    write_text,
)
from data_schemas.manifest import Artefact
from data_schemas.skeleton import BODY_GROUPS, NO_GROUP, Motion, Skeleton

__all__ = ["ClipRow", "MotionReader", "MotionWriter", "read_clips", "skeleton_id", "write_clips"]

UP_AXES = ("x", "y", "z")
_LENGTH_DECIMALS = 5  # hundredths of a millimetre: smaller differences are rounding errors of text files


def skeleton_id(skeleton: Skeleton) -> str:
    """Content id of a skeleton: equal for skeletons with the same joints, bones, groups, unit and up axis.

    Lengths are compared to 0.01 mm. The source's header is ignored, so that clips of one rig share their skeleton
    even if the text of their headers differs.
    """
    lengths = [np.round(a, _LENGTH_DECIMALS) + 0.0 for a in (skeleton.offsets, skeleton.tails)]  # + 0.0: no -0.0
    content = json.dumps(
        [
            list(skeleton.names),
            skeleton.parents.tolist(),
            [array.tolist() for array in lengths],
            skeleton.groups.tolist(),
            [bool(s) for s in skeleton.sampled],
            int(skeleton.root),
            float(skeleton.unit_m),
            skeleton.up_axis,
        ]
    )
    return hashlib.sha256(content.encode("utf-8", errors="backslashreplace")).hexdigest()[:12]


class MotionWriter(ClipWriter):
    """Writes motions into a draft's folder. Use as a context manager, or call `close`.

    Args:
        folder: an existing folder, such as `Draft.folder`.
    """

    FILE = "motions.h5"

    def __init__(self, folder: str | os.PathLike[str]):
        super().__init__(folder, libver="v110")  # an array of one chunk needs no index: a tenth of small clips' bytes
        self._skeletons = self._file.create_group("skeletons")
        self._joints: dict[str, int] = {}

    def add_skeleton(self, skeleton: Skeleton) -> str:
        """Store the skeleton unless an equal one is stored, and return its id. Raises InputError if it is invalid."""
        fault = fault_of_skeleton(skeleton)
        if fault:
            raise InputError(f"The skeleton {fault}.")
        name = skeleton_id(skeleton)
        if name in self._joints:
            return name
        write_skeleton(self._skeletons.create_group(name), skeleton)
        self._joints[name] = skeleton.joints
        return name

    def add_clip(self, row: ClipRow, motion: Motion) -> None:
        """Store a motion of a skeleton that was added before (`row.skeleton`).

        Raises:
            InputError: the row and the motion disagree, a name occurs twice, or the motion is not finite.
        """
        if row.skeleton not in self._joints:
            raise InputError(f"The clip {row.clip!r} names the skeleton {row.skeleton!r}, which was not added.")
        fault = fault_of_motion(motion, self._joints[row.skeleton])
        if fault is None and abs(row.fps - motion.fps) > 1e-9 * motion.fps:
            fault = f"has {motion.fps} frames a second, its row says {row.fps}"
        if fault:
            raise InputError(f"The motion {row.clip!r} {fault}.")
        group = self._new_clip(row, motion.frames)
        write_frames(group, "rotations", np.asarray(motion.rotations, np.float32))
        write_frames(group, "root_positions", np.asarray(motion.root_positions, np.float32))
        if len(motion.track_joints):
            group.create_dataset("track_joints", data=np.asarray(motion.track_joints, np.int32))
            write_frames(group, "tracks", np.asarray(motion.tracks, np.float32))


class MotionReader(ClipReader):
    """Reads a `motion` artefact. `clips` is its index; windows of motions are read from the disk on demand."""

    KIND = "motion"
    FILE = "motions.h5"

    def __init__(self, artefact: Artefact | str | os.PathLike[str]):
        self._known: dict[str, Skeleton] = {}
        super().__init__(artefact)

    def skeletons(self) -> tuple[str, ...]:
        """Ids of all skeletons, sorted."""
        with reading(self._path):
            return tuple(sorted(group_in(self._file, "skeletons")))

    def skeleton(self, name: str) -> Skeleton:
        """The skeleton with this id. Raises InputError if it does not exist or is damaged."""
        if name not in self._known:
            with reading(self._path):
                stored = group_in(self._file, "skeletons")
                if name not in tuple(stored):
                    raise InputError(f"{self.artefact.path} has no skeleton {name!r}.")
                self._known[name] = read_skeleton(group_in(stored, name))
        return self._known[name]

    def motion(self, clip: str, start: int = 0, stop: int | None = None) -> Motion:
        """Frames `start` to `stop` (not included; None: to the end) of a clip.

        Raises:
            InputError: no such clip or frames, or the file is damaged.
        """
        row = self.row(clip)
        window = self._window(row, start, stop)
        joints = self.skeleton(row.skeleton).joints
        with reading(self._path):
            group = self._group(row)
            motion = Motion(
                rotations=read_frames(group, "rotations", window, (joints, 4), row.frames).astype(
                    np.float32, copy=False
                ),
                root_positions=read_frames(group, "root_positions", window, (3,), row.frames).astype(
                    np.float32, copy=False
                ),
                fps=row.fps,
                **_read_tracks(group, row, window),
            )
            fault = fault_of_motion(motion, joints)
            if fault:
                raise InputError(f"{self._path} is damaged: the motion {clip!r} {fault}.")
            return motion


def _read_tracks(group: h5py.Group, row: ClipRow, window: slice) -> dict[str, np.ndarray]:
    if "track_joints" not in group:
        return {"tracks": np.zeros((window.stop - window.start, 0, 3), np.float32)}
    joints = read_whole(group, "track_joints", np.int32, (None,))
    tracks = read_frames(group, "tracks", window, (len(joints), 3), row.frames)
    return {"track_joints": joints, "tracks": tracks.astype(np.float32, copy=False)}


def write_skeleton(group: h5py.Group, skeleton: Skeleton) -> None:
    """Store a skeleton in an empty group."""
    write_text(group, "names", "\n".join(skeleton.names))
    write_text(group, "header", skeleton.header)
    group.create_dataset("parents", data=np.asarray(skeleton.parents, np.int32))
    group.create_dataset("offsets", data=np.asarray(skeleton.offsets, np.float64))
    group.create_dataset("tails", data=np.asarray(skeleton.tails, np.float64))
    group.create_dataset("groups", data=np.asarray(skeleton.groups, np.int8))
    group.create_dataset("sampled", data=np.asarray(skeleton.sampled, np.uint8))
    group.attrs["root"] = int(skeleton.root)
    group.attrs["unit_m"] = float(skeleton.unit_m)
    group.attrs["up_axis"] = skeleton.up_axis


def read_skeleton(group: h5py.Group) -> Skeleton:
    """Read what `write_skeleton` stored. Raises ValueError for other data."""
    names = read_text(group, "names").split("\n")
    joints = len(names)
    skeleton = Skeleton(
        names=tuple(names),
        parents=read_whole(group, "parents", np.int32, (joints,)),
        offsets=read_whole(group, "offsets", np.float64, (joints, 3)),
        tails=read_whole(group, "tails", np.float64, (joints, 3)),
        groups=read_whole(group, "groups", np.int8, (joints,)),
        sampled=read_whole(group, "sampled", bool, (joints,)),
        root=int(np.asarray(group.attrs["root"])),
        unit_m=float(np.asarray(group.attrs["unit_m"])),
        up_axis=str(group.attrs["up_axis"]),
        header=read_text(group, "header"),
    )
    fault = fault_of_skeleton(skeleton)
    if fault:
        raise ValueError(f"{group.name} {fault}")
    return skeleton


def fault_of_skeleton(skeleton: Skeleton) -> str | None:
    """The fault of a skeleton's arrays, as the end of a sentence; None if they are consistent."""
    joints = skeleton.joints
    shapes = {
        "parents": (joints,),
        "offsets": (joints, 3),
        "tails": (joints, 3),
        "groups": (joints,),
        "sampled": (joints,),
    }
    for name, shape in shapes.items():
        if np.shape(getattr(skeleton, name)) != shape:
            return f"has {joints} joints but {name} of the shape {np.shape(getattr(skeleton, name))}"
    if joints == 0:
        return "has no joints"
    if any("\n" in name for name in skeleton.names):
        return "has a joint whose name holds a line break"
    if skeleton.parents[0] != -1 or (skeleton.parents[1:] < 0).any() or (skeleton.parents >= np.arange(joints)).any():
        return "has a joint that does not come after its parent, or two roots"
    if not (np.isfinite(skeleton.offsets).all() and np.isfinite(skeleton.tails).all()):
        return "has an offset or a tail that is not finite"
    if ((skeleton.groups < NO_GROUP) | (skeleton.groups >= len(BODY_GROUPS))).any():
        return f"has a body group outside {NO_GROUP} to {len(BODY_GROUPS) - 1}"
    if not 0 <= skeleton.root < joints:
        return f"has the pelvis {skeleton.root}, which is none of its {joints} joints"
    if not (np.isfinite(skeleton.unit_m) and skeleton.unit_m > 0):
        return f"has a unit of {skeleton.unit_m} metres"
    if skeleton.up_axis not in UP_AXES:
        return f"has the up axis {skeleton.up_axis!r}, and there are {', '.join(UP_AXES)}"
    return None


def fault_of_motion(motion: Motion, joints: int) -> str | None:
    """The fault of a motion's arrays, as the end of a sentence; None if they can be stored for `joints` joints."""
    frames, tracked = motion.rotations.shape[0], len(motion.track_joints)
    if frames == 0:
        return "has no frames"
    expected = {"rotations": (frames, joints, 4), "root_positions": (frames, 3)}
    if tracked:
        expected["tracks"] = (frames, tracked, 3)
    fault = fault_of_arrays(motion, expected)
    if fault:
        return fault
    if not are_unit(motion.rotations):
        return "has rotations that are not unit quaternions"
    if tracked and not ((motion.track_joints > 0) & (motion.track_joints < joints)).all():
        return f"has a track on a joint outside 1 to {joints - 1}"
    if not (np.isfinite(motion.fps) and motion.fps > 0):
        return f"has {motion.fps} frames a second"
    return None
