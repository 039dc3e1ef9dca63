"""The `concepts` artefact: motions as anchor frames and the splines between them, with the joints' positions.

`concepts.h5`:
    attribute price                the lambda of the segmentation
    /bodies/<id>    names, groups, parents: J joints, the pelvis first
    /clips/<clip>   positions (T, J, 3) float32 metres on a body of the standard stature; anchors (A,) int32 frames,
                    the first and the last frame included; splines (A - 1, 4, J, 3) float32 metres, coefficients of
                    the powers 0 to 3 of the time in each transition, from 0 to 1; clusters (A,) int32, the anchor
                    concept of each anchor within its action, -1 for none; attributes action, scale
    /centres/<action>  (n, J, 3) float32 metres: the anchor concepts of an action, relative to the pelvis
`clips.parquet`: one ClipRow a clip; its `skeleton` is the body's id, its frames and rate are those of `positions`.
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass

import numpy as np

from data_schemas.clips import ClipReader, ClipRow, ClipWriter
from data_schemas.damaged_files import reading
from data_schemas.errors import InputError
from data_schemas.hdf5_arrays import (
    fault_of_arrays,
    group_in,
    read_frames,
    read_text,
    read_whole,
    write_frames,
    write_text,
)
from data_schemas.manifest import Artefact

__all__ = ["ClipRow", "ConceptsReader", "ConceptsWriter", "SegmentedClip", "StoredBody"]

NO_CLUSTER = -1
_POWERS = 4


@dataclass(frozen=True)
class StoredBody:
    """Joints: J names, parents (J,) int32 with -1 for the pelvis, which is the first; groups (J,) int8."""

    names: tuple[str, ...]
    parents: np.ndarray
    groups: np.ndarray

    @property
    def id(self) -> str:
        content = json.dumps([list(self.names), self.parents.tolist(), self.groups.tolist()])
        return hashlib.sha256(content.encode("utf-8", errors="backslashreplace")).hexdigest()[:12]


@dataclass(frozen=True)
class SegmentedClip:
    """One motion in segments.

    positions: (T, J, 3) float32 metres, on a body of the standard stature.
    anchors:   (A,) int32 rising frames, from 0 to T - 1. splines: (A - 1, 4, J, 3) float32.
    clusters:  (A,) int32, -1 for none. action: "" if it is not known. scale: from metres on the rig to these.
    """

    positions: np.ndarray
    anchors: np.ndarray
    splines: np.ndarray
    clusters: np.ndarray
    action: str
    scale: float


class ConceptsWriter(ClipWriter):
    """Writes segmented clips into a draft's folder. Use as a context manager, or call `close`."""

    FILE = "concepts.h5"

    def __init__(self, folder: str | os.PathLike[str], price: float):
        super().__init__(folder, libver="v110")
        self._file.attrs["price"] = float(price)
        self._bodies = self._file.create_group("bodies")
        self._centres = self._file.create_group("centres")
        self._joints: dict[str, int] = {}

    def add_body(self, body: StoredBody) -> str:
        """Store the body unless an equal one is stored, and return its id."""
        name = body.id
        if name not in self._joints:
            group = self._bodies.create_group(name)
            write_text(group, "names", "\n".join(body.names))
            group.create_dataset("parents", data=np.asarray(body.parents, np.int32))
            group.create_dataset("groups", data=np.asarray(body.groups, np.int8))
            self._joints[name] = len(body.names)
        return name

    def add(self, row: ClipRow, clip: SegmentedClip) -> None:
        """Store a clip of a body that was added before (`row.skeleton`). Raises InputError if it is inconsistent."""
        if row.skeleton not in self._joints:
            raise InputError(f"The clip {row.clip!r} names the body {row.skeleton!r}, which was not added.")
        fault = _fault_of(clip, self._joints[row.skeleton])
        if fault:
            raise InputError(f"The clip {row.clip!r} {fault}.")
        group = self._new_clip(row, len(clip.positions))
        write_frames(group, "positions", np.asarray(clip.positions, np.float32))
        group.create_dataset("anchors", data=np.asarray(clip.anchors, np.int32))
        group.create_dataset("splines", data=np.asarray(clip.splines, np.float32))
        group.create_dataset("clusters", data=np.asarray(clip.clusters, np.int32))
        write_text(group, "action", clip.action)
        group.attrs["scale"] = float(clip.scale)

    def add_centres(self, action: str, centres: np.ndarray) -> None:
        """Store the anchor concepts (n, J, 3) of an action."""
        number = len(self._centres)
        group = self._centres.create_group(f"{number:05d}")
        write_text(group, "action", action)
        group.create_dataset("poses", data=np.asarray(centres, np.float32))


class ConceptsReader(ClipReader):
    """Reads a `concepts` artefact. `clips` is its index, `price` the lambda of its segmentation."""

    KIND = "concepts"
    FILE = "concepts.h5"

    def __init__(self, artefact: Artefact | str | os.PathLike[str]):
        super().__init__(artefact)
        with reading(self._path):
            self.price = float(np.asarray(self._file.attrs["price"]))

    def body(self, name: str) -> StoredBody:
        """The body with this id. Raises InputError if there is none, or it is damaged."""
        with reading(self._path):
            group = group_in(group_in(self._file, "bodies"), name)
            names = tuple(read_text(group, "names").split("\n"))
            parents = read_whole(group, "parents", np.int32, (len(names),))
            groups = read_whole(group, "groups", np.int8, (len(names),))
            if parents[0] != -1 or (parents[1:] < 0).any() or (parents >= np.arange(len(names))).any():
                raise ValueError(f"{group.name} has a joint that does not come after its parent")
            return StoredBody(names, parents, groups)

    def action(self, clip: str) -> str:
        """The action of a clip, "" if it is not known."""
        with reading(self._path):
            return read_text(self._group(self.row(clip)), "action")

    def segmented(self, clip: str) -> SegmentedClip:
        """A clip. Raises InputError: no such clip, or the file is damaged."""
        row = self.row(clip)
        joints = len(self.body(row.skeleton).names)
        with reading(self._path):
            group = self._group(row)
            anchors = read_whole(group, "anchors", np.int32, (None,))
            count = len(anchors)
            found = SegmentedClip(
                positions=read_frames(group, "positions", slice(0, row.frames), (joints, 3), row.frames),
                anchors=anchors,
                splines=read_whole(group, "splines", np.float32, (max(count - 1, 0), _POWERS, joints, 3)),
                clusters=read_whole(group, "clusters", np.int32, (count,)),
                action=read_text(group, "action"),
                scale=float(np.asarray(group.attrs["scale"])),
            )
            fault = _fault_of(found, joints)
            if fault:
                raise ValueError(f"the clip {clip!r} {fault}")
            return found

    def centres(self) -> dict[str, np.ndarray]:
        """Action -> its anchor concepts (n, J, 3)."""
        with reading(self._path):
            stored = group_in(self._file, "centres")
            out = {}
            for name in sorted(stored):
                group = group_in(stored, name)
                out[read_text(group, "action")] = read_whole(group, "poses", np.float32, (None, None, 3))
            return out


def _fault_of(clip: SegmentedClip, joints: int) -> str | None:
    """The fault of a segmented clip, as the end of a sentence; None if it is consistent."""
    frames, count = len(clip.positions), len(clip.anchors)
    shapes = {
        "positions": (frames, joints, 3),
        "splines": (max(count - 1, 0), _POWERS, joints, 3),
        "clusters": (count,),
    }
    fault = fault_of_arrays(clip, shapes)
    if fault:
        return fault
    if not count or clip.anchors[0] != 0 or clip.anchors[-1] != frames - 1 or (np.diff(clip.anchors) <= 0).any():
        return "has anchors that do not rise from its first to its last frame"
    if (clip.clusters < NO_CLUSTER).any():
        return "has an anchor of a cluster below -1"
    if not (np.isfinite(clip.scale) and clip.scale > 0):
        return f"has the scale {clip.scale}"
    return None
