"""The filled windows of an evaluation: `fills.h5`, a file that a `metrics` artefact may have.

`fills.h5`:
    attribute fps
    /skeletons/<id>  as in `motions.h5`
    /batches/<n>     attributes archive, task, interval, skeleton; clips (W names, a text); starts (W,) int32;
                     known (T,) uint8; origins (W, 3) float32 metres
        methods/<m>  attributes method, scale_m; positions (W, T, K, 3) int16; rotations (W, T, K, 4) int16

A batch is W windows of T frames of one skeleton, for one task; K are the joints of the body. A joint lies at
origin + scale_m * position; a rotation is a global quaternion xyzw times 32767. Both are stored as differences from
frame to frame, modulo 2^16, which take about half the bytes of the values.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from data_schemas.damaged_files import reading
from data_schemas.errors import InputError
from data_schemas.hdf5_arrays import group_in, read_frames, read_text, read_whole, write_text
from data_schemas.hdf5_writing import NewHdf5
from data_schemas.manifest import Artefact, read_newest
from data_schemas.motion import read_skeleton, skeleton_id, write_skeleton
from data_schemas.skeleton import NO_GROUP, Skeleton

FILLS_NAME = "fills.h5"
LARGEST_STEP = 32767
_AXES = {"positions": 3, "rotations": 4}
BYTES_OF_A_JOINT = 2 * sum(_AXES.values())  # in one frame of one fill, before compression


@dataclass(frozen=True)
class FilledBatch:
    """W windows of one length on one skeleton, which all methods filled for one task.

    number:   its place in the file.
    archive:  the archive or category of the clips. interval: as in `MetricRow`.
    skeleton: id of the skeleton.
    clips, starts: (W) the clip of each window, and its first frame there at 30 frames a second.
    known:    (T,) bool, True where the frame was given.
    methods:  those whose fills are kept, in the order in which they were measured.
    """

    number: int
    archive: str
    task: str
    interval: int
    skeleton: str
    clips: tuple[str, ...]
    starts: tuple[int, ...]
    known: np.ndarray
    methods: tuple[str, ...] = ()


def kept_joints(skeleton: Skeleton) -> np.ndarray:
    """(K,) the joints whose poses are kept: those of the body."""
    return np.flatnonzero(skeleton.groups != NO_GROUP)


class FillsWriter:
    """Writes the fills of an evaluation into its draft's folder. Use as a context manager.

    Raises: OSError, from each method, if the disk is full.
    """

    def __init__(self, folder: str | os.PathLike[str], fps: float):
        self._new = NewHdf5(Path(folder) / FILLS_NAME)
        self._new.file.attrs["fps"] = fps
        self._skeletons = self._new.file.create_group("skeletons")
        self._batches = self._new.file.create_group("batches")

    def begin(self, batch: FilledBatch, skeleton: Skeleton, origins: np.ndarray) -> None:
        """Begin a batch, whose fills `add` then stores. Its `skeleton`, `number` and `methods` are not read.

        origins: (W, 3) metres, a place near each window's motion.
        """
        name = skeleton_id(skeleton)
        if name not in self._skeletons:
            write_skeleton(self._skeletons.create_group(name), skeleton)
        self._joints, self._origins = kept_joints(skeleton), np.asarray(origins, np.float32)
        group = self._group = self._batches.create_group(str(len(self._batches)))
        group.attrs.update(
            {"archive": batch.archive, "task": batch.task, "interval": batch.interval, "skeleton": name}
        )
        write_text(group, "clips", "\n".join(batch.clips))
        group.create_dataset("starts", data=np.asarray(batch.starts, np.int32))
        group.create_dataset("known", data=np.asarray(batch.known, np.uint8))
        group.create_dataset("origins", data=self._origins)
        self._methods = group.create_group("methods")

    def add(self, method: str, positions: np.ndarray, rotations: np.ndarray) -> None:
        """Store what a method made of the batch.

        positions: (W, T, J, 3) metres and rotations: (W, T, J, 4) unit quaternions xyzw, both global, of all joints.

        Raises: InputError if they are not finite.
        """
        near = positions[:, :, self._joints].astype(np.float64) - self._origins[:, None, None]
        turns = rotations[:, :, self._joints]
        if not (np.isfinite(near).all() and np.isfinite(turns).all()):
            raise InputError(f"{method} made values that are not finite.", "Leave --keep-fills away.")
        scale = max(float(np.abs(near).max(initial=0)), 1e-6) / LARGEST_STEP
        group = self._methods.create_group(str(len(self._methods)))
        group.attrs.update({"method": method, "scale_m": scale})
        for name, values in (("positions", near / scale), ("rotations", turns * LARGEST_STEP)):
            whole = np.clip(np.round(values), -LARGEST_STEP, LARGEST_STEP).astype(np.int16)
            steps = np.diff(whole, axis=1, prepend=np.zeros_like(whole[:, :1]))
            group.create_dataset(
                name, data=steps, chunks=(1, *steps.shape[1:]), compression="gzip", shuffle=True, fletcher32=True
            )
        self._new.check()

    def __enter__(self) -> FillsWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        if kind is None:
            self._new.close()
        else:
            self._new.discard()


class FillsReader:
    """Reads the fills of an evaluation. `batches` is their index, `fps` the frame rate of the windows.

    Args:
        artefact: a metrics artefact, or its path.

    Raises:
        InputError: it keeps no fills, is of another kind, or damaged.
    """

    def __init__(self, artefact: Artefact | str | os.PathLike[str]):
        read_newest(artefact, "metrics", self._open)

    def _open(self, artefact: Artefact) -> None:
        self.artefact = artefact
        self._path = artefact.folder / FILLS_NAME
        if not self._path.exists():
            raise InputError(
                f"{self.artefact.path} keeps no filled windows.", "Run `pumps evaluate` again, with --keep-fills."
            )
        with reading(self._path):
            self._file = h5py.File(self._path, "r", locking=False)
            try:
                self.fps = float(np.asarray(self._file.attrs["fps"]))
                stored = group_in(self._file, "batches")
                self.batches = tuple(_read_batch(group_in(stored, str(n)), n) for n in range(len(stored)))
            except BaseException:
                self._file.close()
                raise

    def skeleton(self, name: str) -> Skeleton:
        """The skeleton with this id. Raises InputError if it does not exist or is damaged."""
        with reading(self._path):
            return read_skeleton(group_in(group_in(self._file, "skeletons"), name))

    def poses(self, batch: FilledBatch, method: str, windows: slice = slice(None)) -> tuple[np.ndarray, np.ndarray]:
        """What a method made of some of the batch's windows.

        Returns: positions (W, T, K, 3) metres and unit quaternions xyzw (W, T, K, 4) of the body's joints, float32.

        Raises: InputError if the method filled no such batch, or the file is damaged.
        """
        if method not in batch.methods:
            raise InputError(f"{self.artefact.path} keeps no fills of {method}.")
        count = len(batch.clips)
        window = slice(*windows.indices(count))
        with reading(self._path):
            joints = len(kept_joints(self.skeleton(batch.skeleton)))
            outer = group_in(group_in(self._file, "batches"), str(batch.number))
            group = group_in(group_in(outer, "methods"), str(batch.methods.index(method)))
            frames, found = len(batch.known), {}
            for name, axes in _AXES.items():
                steps = read_frames(group, name, window, (frames, joints, axes), count)
                found[name] = np.cumsum(steps, axis=1, dtype=np.int16).astype(np.float32)
            origins = read_whole(outer, "origins", np.float32, (count, 3))[window]
            scale = float(np.asarray(group.attrs["scale_m"]))
            lengths = np.linalg.norm(found["rotations"], axis=-1, keepdims=True)
            if not (np.isfinite(scale) and np.isfinite(origins).all() and lengths.all()):
                raise ValueError(f"{group.name} holds no poses")
        return origins[:, None, None] + found["positions"] * np.float32(scale), found["rotations"] / lengths

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> FillsReader:
        return self

    def __exit__(self, *rest: object) -> None:
        self.close()


def _read_batch(group: h5py.Group, number: int) -> FilledBatch:
    clips = tuple(read_text(group, "clips").split("\n"))
    methods = group_in(group, "methods")
    return FilledBatch(
        number=number,
        archive=str(group.attrs["archive"]),
        task=str(group.attrs["task"]),
        interval=int(np.asarray(group.attrs["interval"])),
        skeleton=str(group.attrs["skeleton"]),
        clips=clips,
        starts=tuple(read_whole(group, "starts", np.int64, (len(clips),)).tolist()),
        known=read_whole(group, "known", bool, (None,)),
        methods=_names([str(group_in(methods, str(n)).attrs["method"]) for n in range(len(methods))]),
    )


def _names(methods: Sequence[str]) -> tuple[str, ...]:
    if len(set(methods)) < len(methods):
        raise ValueError("a method comes twice")
    return tuple(methods)
