"""The `tpc` artefact: temporal point clouds, in three layouts with one reader.

A *rigid* cloud is stored factored: once the points drawn on a skeleton's bones, and for every frame the bones' global
transforms; a point is `head + rotate(rotation, alpha * tail + sigma * offset)`. A *packed* cloud is a rigid one in an
eighth of the space (`data_schemas.packed_transforms`). A *dense* cloud is stored as its points.

`clouds.h5`:
    /bones/<id>    parents, tails, groups, weights; point_bones, point_alphas, point_offsets
    /clips/<clip>  rigid: heads (T, B, 3), rotations (T, B, 4) float32 global xyzw
                   packed: turns, places int16 and int32 differences
                   dense: points (T, P, 3) float32, groups (P,) int8
`clips.parquet`: one ClipRow a clip; the skeleton of a rigid clip is the id of its bones.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass, fields
from typing import Literal

import h5py
import numpy as np
from scipy.spatial.transform import Rotation

from data_schemas.clips import ClipReader, ClipRow, ClipWriter
from data_schemas.damaged_files import reading
from data_schemas.errors import InputError
from data_schemas.hdf5_arrays import are_unit, fault_of_arrays, group_in, read_frames, read_whole, write_frames
from data_schemas.manifest import Artefact
from data_schemas.packed_transforms import is_packed, read_packed, write_packed
from data_schemas.skeleton import BODY_GROUPS

__all__ = ["BoneSet", "ClipRow", "TpcReader", "TpcWriter", "place_points"]


@dataclass(frozen=True)
class BoneSet:
    """The B bones of a skeleton that carry points, and P points drawn on them.

    parents:       (B,) int32, -1 for the pelvis, which comes first; parents before children.
    tails:         (B, 3) float32 metres, in the bone's own frame.
    groups:        (B,) int8 index into BODY_GROUPS.
    weights:       (B,) float32 probability of drawing a point on the bone, 0 for bones without points.
    point_bones:   (P,) int32 the bone of each point.
    point_alphas:  (P,) float32 how far along the bone, 0 at its head, 1 at its tail.
    point_offsets: (P, 3) float32 standard normal draws, in the bone's frame, to be scaled by sigma.
    """

    parents: np.ndarray
    tails: np.ndarray
    groups: np.ndarray
    weights: np.ndarray
    point_bones: np.ndarray
    point_alphas: np.ndarray
    point_offsets: np.ndarray


_BONE_ARRAYS: dict[str, tuple[type, str]] = {
    "parents": (np.int32, "B"),
    "tails": (np.float32, "B3"),
    "groups": (np.int8, "B"),
    "weights": (np.float32, "B"),
    "point_bones": (np.int32, "P"),
    "point_alphas": (np.float32, "P"),
    "point_offsets": (np.float32, "P3"),
}


class TpcWriter(ClipWriter):
    """Writes point clouds into a draft's folder. Use as a context manager, or call `close`."""

    FILE = "clouds.h5"

    def __init__(self, folder: str | os.PathLike[str], *, packed: bool = False):
        """Args: packed: store rigid clips in an eighth of the space, exact to fractions of a millimetre."""
        # Per clip the newer HDF5 format takes hundreds of bytes, the older one kilobytes.
        super().__init__(folder, libver="latest" if packed else None)
        self._packed = packed
        self._parents: dict[str, np.ndarray] = {}
        self._bones = self._file.create_group("bones")
        self._bone_counts: dict[str, int] = {}

    def add_bones(self, bones: BoneSet, skeleton: str | None = None) -> str:
        """Store the bones and their points, and return the id that rows name as `skeleton`.

        Args:
            skeleton: the id to store them under (the skeleton's own, which clips refer to); None: an id by content.

        Raises:
            InputError: the arrays do not match, or different bones are stored under this id.
        """
        arrays = {
            name: np.ascontiguousarray(getattr(bones, name), dtype) for name, (dtype, _) in _BONE_ARRAYS.items()
        }
        fault = _fault_of_bones(BoneSet(**arrays))
        content = hashlib.sha256(b"".join(a.tobytes() for a in arrays.values())).hexdigest()[:12]
        name = content if skeleton is None else skeleton
        if fault is None and (not name or "/" in name or name in (".", "..")):
            fault = f"cannot be stored under the id {name!r}"
        if fault:
            raise InputError(f"The set of bones {fault}.")
        if name in self._bone_counts:
            if group_in(self._bones, name).attrs["content"] != content:
                raise InputError(f"Two different sets of bones have the id {name!r}.")
            return name
        group = self._bones.create_group(name)
        group.attrs["content"] = content
        for key, values in arrays.items():
            group.create_dataset(key, data=values)
        self._bone_counts[name] = len(arrays["parents"])
        self._parents[name] = arrays["parents"]
        return name

    def add_rigid(self, row: ClipRow, heads: np.ndarray, rotations: np.ndarray) -> None:
        """Store a rigid clip on the bones `row.skeleton`: heads (T, B, 3) metres, rotations (T, B, 4) global xyzw.

        Raises:
            InputError: the bones were not added, or the arrays do not match them or are not finite.
        """
        if row.skeleton not in self._bone_counts:
            raise InputError(f"The clip {row.clip!r} names the bones {row.skeleton!r}, which were not added.")
        count = self._bone_counts[row.skeleton]
        _check_frames(row, "heads", heads, (row.frames, count, 3))
        _check_frames(row, "rotations", rotations, (row.frames, count, 4))
        if not are_unit(rotations):
            raise InputError(f"The clip {row.clip!r} has rotations that are not unit quaternions.")
        group = self._new_clip(row, heads.shape[0])
        if self._packed:
            write_packed(group, heads, rotations, self._parents[row.skeleton])
            return
        write_frames(group, "heads", np.asarray(heads, np.float32))
        write_frames(group, "rotations", np.asarray(rotations, np.float32))

    def add_dense(self, row: ClipRow, points: np.ndarray, groups: np.ndarray) -> None:
        """Store a clip of points (T, P, 3) metres with their body groups (P,).

        Raises:
            InputError: the arrays do not match or are not finite.
        """
        _check_frames(row, "points", points, (row.frames, len(groups), 3))
        if not ((groups >= 0) & (groups < len(BODY_GROUPS))).all():
            raise InputError(
                f"The clip {row.clip!r} has a point with a body group outside 0 to {len(BODY_GROUPS) - 1}."
            )
        group = self._new_clip(row, points.shape[0])
        write_frames(group, "points", np.asarray(points, np.float32))
        group.create_dataset("groups", data=np.asarray(groups, np.int8))


class TpcReader(ClipReader):
    """Reads a `tpc` artefact of any layout. `clips` is its index."""

    KIND = "tpc"
    FILE = "clouds.h5"

    def __init__(self, artefact: Artefact | str | os.PathLike[str]):
        self._known: dict[str, BoneSet] = {}
        super().__init__(artefact)

    def layout(self, clip: str) -> Literal["rigid", "dense"]:
        """Whether a clip has bones (packed or not) or points. Raises InputError if there is no such clip."""
        row = self.row(clip)
        with reading(self._path):
            return "dense" if "points" in self._group(row) else "rigid"

    def bones(self, skeleton: str) -> BoneSet:
        """The bones with this id. Raises InputError if they do not exist or are damaged."""
        if skeleton not in self._known:
            with reading(self._path):
                stored = group_in(self._file, "bones")
                if skeleton not in tuple(stored):
                    raise InputError(f"{self.artefact.path} has no bones {skeleton!r}.")
                self._known[skeleton] = _read_bones(group_in(stored, skeleton))
        return self._known[skeleton]

    def transforms(self, clip: str, start: int = 0, stop: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Heads (T, B, 3) and global rotations (T, B, 4) xyzw, float32, of frames `start` to `stop` of a rigid clip.

        Raises:
            InputError: no such clip or frames, the clip is dense, or the file is damaged.
        """
        row = self.row(clip)
        window = self._window(row, start, stop)
        if self.layout(clip) == "dense":
            raise InputError(
                f"The clip {clip!r} of {self.artefact.path} is a dense cloud: it has points but no bones."
            )
        parents = self.bones(row.skeleton).parents
        count = len(parents)
        with reading(self._path):
            group = self._group(row)
            if is_packed(group):
                return read_packed(group, window, parents, row.frames)
            heads = read_frames(group, "heads", window, (count, 3), row.frames)
            rotations = read_frames(group, "rotations", window, (count, 4), row.frames)
            if not are_unit(rotations):
                raise ValueError(f"the rotations of {clip!r} are not unit quaternions")
            return heads.astype(np.float32, copy=False), rotations.astype(np.float32, copy=False)

    def points(
        self, clip: str, start: int = 0, stop: int | None = None, sigma_m: float = 0.05
    ) -> tuple[np.ndarray, np.ndarray]:
        """Points (T, P, 3) float32 metres and body groups (P,) int8 of frames `start` to `stop`, for all layouts.

        Args:
            sigma_m: standard deviation of a rigid cloud's points around their bones; not used for a dense cloud.

        Raises:
            InputError: no such clip or frames, or the file is damaged.
        """
        row = self.row(clip)
        if self.layout(clip) == "rigid":
            heads, rotations = self.transforms(clip, start, stop)
            bones = self.bones(row.skeleton)
            return place_points(bones, heads, rotations, sigma_m), bones.groups[bones.point_bones]
        window = self._window(row, start, stop)
        with reading(self._path):
            group = self._group(row)
            groups = read_whole(group, "groups", np.int8, (None,))
            points = read_frames(group, "points", window, (len(groups), 3), row.frames)
            return points.astype(np.float32, copy=False), groups


def place_points(bones: BoneSet, heads: np.ndarray, rotations: np.ndarray, sigma_m: float) -> np.ndarray:
    """Positions of the bones' points: head + rotate(rotation, alpha * tail + sigma * offset) (PC-MRL eq. 3).

    `stages.shared.pointcloud.drawn_points` has the same equation for torch, which this package must not load. The two
    results differ by rounding: here one matrix product places all points, there each point has its own.

    Args:
        heads: (T, B, 3) metres.
        rotations: (T, B, 4) global xyzw.
        sigma_m: scale of the offsets.

    Returns:
        (T, P, 3) float32 metres.
    """
    frames, count = heads.shape[:2]
    points = len(bones.point_bones)
    frame_of_bone = np.empty((frames, 3, count, 4), np.float32)
    frame_of_bone[..., :3] = (
        Rotation.from_quat(rotations.reshape(-1, 4)).as_matrix().reshape(frames, count, 3, 3).swapaxes(1, 2)
    )
    frame_of_bone[..., 3] = heads.swapaxes(1, 2)
    # A point's coordinates in its own bone's frame, zero for all other bones: one matrix product gives all positions.
    local = np.zeros((count, 4, points), np.float32)
    on, each = bones.point_bones, np.arange(points)
    local[on, :3, each] = bones.point_alphas[:, None] * bones.tails[on] + sigma_m * bones.point_offsets
    local[on, 3, each] = 1
    placed = frame_of_bone.reshape(frames * 3, count * 4) @ local.reshape(count * 4, points)
    return np.ascontiguousarray(placed.reshape(frames, 3, points).swapaxes(1, 2))


def _check_frames(row: ClipRow, name: str, values: np.ndarray, shape: tuple[int, ...]) -> None:
    if values.shape != shape:
        raise InputError(f"The clip {row.clip!r} has {name} of the shape {values.shape}, expected {shape}.")
    if not np.isfinite(values).all():
        raise InputError(f"The clip {row.clip!r} has values in {name} that are not finite.")


def _read_bones(group: h5py.Group) -> BoneSet:
    sizes: dict[str, int | None] = {"B": None, "P": None, "3": 3}
    arrays: dict[str, np.ndarray] = {}
    for field in fields(BoneSet):
        dtype, letters = _BONE_ARRAYS[field.name]
        values = read_whole(group, field.name, dtype, tuple(sizes[letter] for letter in letters))
        sizes[letters[0]] = values.shape[0]
        arrays[field.name] = values
    bones = BoneSet(**arrays)
    fault = _fault_of_bones(bones)
    if fault:
        raise ValueError(f"{group.name} {fault}")
    return bones


def _fault_of_bones(bones: BoneSet) -> str | None:
    sizes = {"B": len(bones.parents), "P": len(bones.point_bones), "3": 3}
    if sizes["B"] == 0:
        return "is empty"
    shapes = {name: tuple(sizes[each] for each in letters) for name, (_, letters) in _BONE_ARRAYS.items()}
    fault = fault_of_arrays(bones, shapes)
    if fault:
        return fault
    if bones.parents[0] != -1 or (bones.parents >= np.arange(sizes["B"])).any() or (bones.parents[1:] < 0).any():
        return "has a bone that does not come after its parent, or two roots"
    if ((bones.groups < 0) | (bones.groups >= len(BODY_GROUPS))).any():
        return f"has a body group outside 0 to {len(BODY_GROUPS) - 1}"
    if (bones.weights < 0).any() or ((bones.point_bones < 0) | (bones.point_bones >= sizes["B"])).any():
        return "has a negative weight, or a point on a bone that does not exist"
    return None
