"""The `mesh` artefact: sequences of meshes of one connectivity.

`meshes.h5`:
    /topology        faces (F, 3) int32; attributes vertices, connectivity
    /joints          names; rows, vertices (E,) int32; weights (E,) float32: the joint regressor
    /skin            names; parents (J,); bones (N, W) int16; weights (N, W) float32       (if meshes have bones)
    /bodies/<id>     vertices (N, 3) float32 metres at rest; heads (J, 3) float64; shape: JSON
    /clips/<clip>    attribute layout; either
                     skinned: rotations (T, J, 4) float32 global xyzw; heads (T, J, 3) float32 metres, or
                     dense:   vertices (T, N, 3) float32 or float16 metres
`clips.parquet`: one ClipRow a clip, whose `skeleton` is the id of its body, or "" for a mesh without one.

The vertices of a skinned clip are computed when a window is read: a frame takes 28 bytes a bone instead of 12 bytes a
vertex. float16 rounds positions to about 1 mm at 2 m; it is for pages and not for measures of edges.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable

import h5py
import numpy as np

from data_schemas.clips import ClipReader, ClipRow, ClipWriter
from data_schemas.damaged_files import reading
from data_schemas.errors import InputError
from data_schemas.hdf5_arrays import are_unit, group_in, read_frames, read_text, read_whole, write_frames, write_text
from data_schemas.manifest import Artefact
from data_schemas.skinned_body import Body, JointRegressor, Skin, Topology, fault_of_topology, skinned_vertices

__all__ = ["ClipRow", "MeshReader", "MeshWriter", "connectivity_digest"]

_CHUNK_BYTES = 4 << 20
SKINNED, DENSE = "skinned", "dense"


def connectivity_digest(faces: np.ndarray, count: int) -> str:
    """Digest of a connectivity: of the number of vertices and the triangles, in their order."""
    total = hashlib.sha256(f"{count}\n".encode())
    total.update(np.ascontiguousarray(faces, "<i4").tobytes())
    return total.hexdigest()[:16]


class MeshWriter(ClipWriter):
    """Writes mesh sequences into a draft's folder. Use as a context manager, or call `close`.

    Args:
        folder: an existing folder, such as `Draft.folder`.
        topology: of all sequences.

    Raises: InputError if the topology is not consistent.
    """

    FILE = "meshes.h5"

    def __init__(self, folder: str | os.PathLike[str], topology: Topology):
        fault = fault_of_topology(topology)
        if fault:
            raise InputError(f"The mesh {fault}.")
        super().__init__(folder, libver="v110")
        self.topology = topology
        self._bodies = self._file.create_group("bodies")
        self._known: set[str] = set()
        group = self._file.create_group("topology")
        group.create_dataset("faces", data=np.asarray(topology.faces, np.int32))
        group.attrs["vertices"] = int(topology.count)
        group.attrs["connectivity"] = connectivity_digest(topology.faces, topology.count)
        joints = self._file.create_group("joints")
        write_text(joints, "names", "\n".join(topology.joints.names))
        for name in ("rows", "vertices", "weights"):
            kind = np.float32 if name == "weights" else np.int32
            joints.create_dataset(name, data=np.asarray(getattr(topology.joints, name), kind))
        if topology.skin is not None:
            skin = self._file.create_group("skin")
            write_text(skin, "names", "\n".join(topology.skin.names))
            skin.create_dataset("parents", data=np.asarray(topology.skin.parents, np.int32))
            skin.create_dataset("bones", data=np.asarray(topology.skin.bones, np.int16))
            skin.create_dataset("weights", data=np.asarray(topology.skin.weights, np.float32))

    def add_body(self, name: str, body: Body) -> None:
        """Store an identity. Raises InputError if its arrays do not fit the topology, or its name is taken."""
        bones = 0 if self.topology.skin is None else len(self.topology.skin.names)
        fault = _fault_of_body(body, self.topology.count, bones)
        if fault is None and (name in self._known or not name or "/" in name):
            fault = "has a name that is taken or cannot be one"
        if fault:
            raise InputError(f"The body {name!r} {fault}.")
        group = self._bodies.create_group(name)
        group.create_dataset("vertices", data=np.asarray(body.vertices, np.float32))
        group.create_dataset("heads", data=np.asarray(body.heads, np.float64).reshape(bones, 3))
        write_text(group, "shape", json.dumps(body.shape, sort_keys=True))
        self._known.add(name)

    def add_skinned(self, row: ClipRow, rotations: np.ndarray, heads: np.ndarray) -> None:
        """Store a clip of the body `row.skeleton`: rotations (T, J, 4) global xyzw, heads (T, J, 3) metres.

        Raises: InputError for a body that was not added, arrays of other shapes, or values that are not finite.
        """
        if self.topology.skin is None or row.skeleton not in self._known:
            raise InputError(
                f"The clip {row.clip!r} names the body {row.skeleton!r}, which was not added with bones."
            )
        bones = len(self.topology.skin.names)
        for name, values, shape in (
            ("rotations", rotations, (row.frames, bones, 4)), ("heads", heads, (row.frames, bones, 3)),
        ):  # fmt: skip
            if values.shape != shape:
                raise InputError(f"The clip {row.clip!r} has {name} of the shape {values.shape}, expected {shape}.")
            if not np.isfinite(values).all():
                raise InputError(f"The clip {row.clip!r} has values in {name} that are not finite.")
        if not are_unit(rotations):
            raise InputError(f"The clip {row.clip!r} has rotations that are not unit quaternions.")
        group = self._new_clip(row, len(rotations))
        group.attrs["layout"] = SKINNED
        write_frames(group, "rotations", np.asarray(rotations, np.float32))
        write_frames(group, "heads", np.asarray(heads, np.float32))

    def add_dense(self, row: ClipRow, parts: Iterable[np.ndarray], dtype: type = np.float32) -> None:
        """Store a clip from its parts in order, each (t, N, 3) metres; no more than one part is held in memory.

        Raises: InputError if the parts do not have the row's frames and the topology's vertices, or are not finite.
        """
        if row.skeleton and row.skeleton not in self._known:
            raise InputError(f"The clip {row.clip!r} names the body {row.skeleton!r}, which was not added.")
        group = self._new_clip(row, row.frames)
        group.attrs["layout"] = DENSE
        count, at = self.topology.count, 0
        chunk = max(1, min(row.frames, _CHUNK_BYTES // (count * 3 * np.dtype(dtype).itemsize)))
        stored = group.create_dataset(
            "vertices", (row.frames, count, 3), np.dtype(dtype), chunks=(chunk, count, 3), fletcher32=True
        )
        for part in parts:
            if part.ndim != 3 or part.shape[1:] != (count, 3) or at + len(part) > row.frames:
                raise InputError(
                    f"The clip {row.clip!r} has vertices of the shape {part.shape} at frame {at}, expected "
                    f"({row.frames - at}, {count}, 3) at most."
                )
            if not np.isfinite(part).all():
                frame = at + int(np.argmax(~np.isfinite(part).all(axis=(1, 2))))
                raise InputError(f"The clip {row.clip!r} has a vertex that is not finite in frame {frame}.")
            stored[at : at + len(part)] = part
            at += len(part)
        if at != row.frames:
            raise InputError(f"The clip {row.clip!r} has {at} frames of vertices, its row says {row.frames}.")


class MeshReader(ClipReader):
    """Reads a `mesh` artefact. `clips` is its index, `topology` its connectivity; frames are read by windows."""

    KIND = "mesh"
    FILE = "meshes.h5"

    topology: Topology

    def __init__(self, artefact: Artefact | str | os.PathLike[str]):
        self._known: dict[str, Body] = {}
        super().__init__(artefact)
        with reading(self._path):
            self.topology = _read_topology(self._file)
            self.connectivity = connectivity_digest(self.topology.faces, self.topology.count)
            fault = fault_of_topology(self.topology)
            if fault:
                raise ValueError(f"its mesh {fault}")

    def check_connectivity(self, digest: str, whose: object) -> None:
        """Raise InputError unless these meshes have the connectivity with this digest."""
        if digest != self.connectivity:
            raise InputError(
                f"{self.artefact.path} holds meshes of another connectivity ({self.connectivity}) than {whose} "
                f"({digest}).",
                "Give meshes with the same triangles in the same order.",
            )

    def bodies(self) -> tuple[str, ...]:
        """Ids of all bodies, sorted."""
        with reading(self._path):
            return tuple(sorted(group_in(self._file, "bodies")))

    def body(self, name: str) -> Body:
        """The body with this id. Raises InputError if it does not exist or is damaged."""
        if name not in self._known:
            with reading(self._path):
                stored = group_in(self._file, "bodies")
                if name not in tuple(stored):
                    raise InputError(f"{self.artefact.path} has no body {name!r}.")
                bones = 0 if self.topology.skin is None else len(self.topology.skin.names)
                self._known[name] = _read_body(group_in(stored, name), self.topology.count, bones)
        return self._known[name]

    def is_skinned(self, clip: str) -> bool:
        """Whether the clip is stored as its bones' transforms. Raises InputError for an unknown clip."""
        row = self.row(clip)
        with reading(self._path):
            layout = str(self._group(row).attrs["layout"])
            if layout not in (SKINNED, DENSE):
                raise ValueError(f"the clip {clip!r} has the layout {layout!r}")
            return layout == SKINNED

    def bones(self, clip: str, start: int = 0, stop: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (T, J, 4) global xyzw and heads (T, J, 3) metres, float32, of frames of a skinned clip.

        Raises: InputError for a clip without bones, no such clip or frames, or a damaged file.
        """
        row = self.row(clip)
        window = self._window(row, start, stop)
        if not self.is_skinned(clip) or self.topology.skin is None:
            raise InputError(f"The clip {clip!r} of {self.artefact.path} is stored as vertices; it has no bones.")
        count = len(self.topology.skin.names)
        with reading(self._path):
            group = self._group(row)
            rotations = read_frames(group, "rotations", window, (count, 4), row.frames)
            heads = read_frames(group, "heads", window, (count, 3), row.frames)
            if not are_unit(rotations):
                raise ValueError(f"{group.name} has rotations that are not unit quaternions")
            return rotations.astype(np.float32, copy=False), heads.astype(np.float32, copy=False)

    def vertices(self, clip: str, start: int = 0, stop: int | None = None) -> np.ndarray:
        """Vertices (T, N, 3) float32 metres of frames `start` to `stop` of a clip, whatever its layout.

        Raises: InputError for no such clip or frames, or a damaged file.
        """
        row = self.row(clip)
        if self.is_skinned(clip) and self.topology.skin is not None:
            return skinned_vertices(self.topology.skin, self.body(row.skeleton), *self.bones(clip, start, stop))
        window = self._window(row, start, stop)
        with reading(self._path):
            values = read_frames(self._group(row), "vertices", window, (self.topology.count, 3), row.frames)
            return values.astype(np.float32, copy=False)


def _read_topology(file: h5py.File) -> Topology:
    group, joints = group_in(file, "topology"), group_in(file, "joints")
    names = tuple(name for name in read_text(joints, "names").split("\n") if name)
    regressor = JointRegressor(
        names,
        read_whole(joints, "rows", np.int32, (None,)),
        read_whole(joints, "vertices", np.int32, (None,)),
        read_whole(joints, "weights", np.float32, (None,)),
    )
    count = int(np.asarray(group.attrs["vertices"]))
    skin = None
    if "skin" in file:
        stored = group_in(file, "skin")
        bones = tuple(read_text(stored, "names").split("\n"))
        skin = Skin(
            bones,
            read_whole(stored, "parents", np.int32, (len(bones),)),
            read_whole(stored, "bones", np.int16, (count, None)),
            read_whole(stored, "weights", np.float32, (count, None)),
        )
    return Topology(read_whole(group, "faces", np.int32, (None, 3)), count, regressor, skin)


def _read_body(group: h5py.Group, count: int, bones: int) -> Body:
    body = Body(
        read_whole(group, "vertices", np.float32, (count, 3)),
        read_whole(group, "heads", np.float64, (bones, 3)),
        {str(name): float(value) for name, value in json.loads(read_text(group, "shape")).items()},
    )
    fault = _fault_of_body(body, count, bones)
    if fault:
        raise ValueError(f"{group.name} {fault}")
    return body


def _fault_of_body(body: Body, count: int, bones: int) -> str | None:
    if body.vertices.shape != (count, 3):
        return f"has vertices of the shape {body.vertices.shape}, expected {(count, 3)}"
    if body.heads.shape != (bones, 3):
        return f"has heads of the shape {body.heads.shape}, expected {(bones, 3)}"
    if not (np.isfinite(body.vertices).all() and np.isfinite(body.heads).all()):
        return "has a vertex or a head that is not finite"
    return None
