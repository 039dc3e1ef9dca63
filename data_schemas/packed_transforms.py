"""Bones' transforms in an eighth of the space: rotations in 16 bits, and places only if they are not constant.

A bone's rotation is stored in its parent's frame, as a rotation vector in steps of pi / 8191. The parent's frame is
the one after quantisation, so that errors do not add up along a chain. A bone's place in its parent's frame is stored
once per clip, unless it moves by more than `PLACE_STEP_M`. Within a chunk the differences from frame to frame are
stored (its first frame as it is), since small numbers compress well; they wrap around, and so does their sum.

    <clip>/turns   (3 B, T) int16 differences        attributes: offsets (B, 3) float32 metres,
    <clip>/places  (3 M, T) int32 differences                    moving (M,) int32, the root first

The error is at most a hundredth of a degree and a fraction of a millimetre (`tests/data_schemas`).
"""

from __future__ import annotations

from typing import Any

import h5py
import numpy as np
from scipy.spatial.transform import Rotation

from data_schemas.declared_sizes import check_stored_array
from data_schemas.hdf5_arrays import CHUNK_FRAMES

TURN_STEP_RAD = np.pi / 8191
PLACE_STEP_M = 1e-4
_TURNS, _PLACES, _OFFSETS, _MOVING = "turns", "places", "offsets", "moving"


def is_packed(group: h5py.Group) -> bool:
    """Whether a clip is stored in this layout."""
    return _TURNS in group


def write_packed(group: h5py.Group, heads: np.ndarray, rotations: np.ndarray, parents: np.ndarray) -> None:
    """Store a clip.

    Args:
        heads: (T, B, 3) metres. rotations: (T, B, 4) global, xyzw.
        parents: (B,), -1 for the root, which is first; parents before children.
    """
    steps, hung = _in_parents(np.asarray(heads, np.float64), np.asarray(rotations, np.float64), parents)
    middle = np.median(hung, axis=0)
    moves = np.abs(hung - middle).max((0, 2)) > PLACE_STEP_M
    moves[0] = True
    moving = np.flatnonzero(moves).astype(np.int32)
    places = np.rint(hung[:, moving] / PLACE_STEP_M)
    if np.abs(places).max(initial=0) > np.iinfo(np.int32).max:
        raise ValueError("a place is too far away to be packed")
    _write(group, _TURNS, steps.reshape(len(steps), -1))
    _write(group, _PLACES, places.astype(np.int32).reshape(len(steps), -1))
    group.attrs[_OFFSETS] = middle.astype(np.float32)
    group.attrs[_MOVING] = moving


def read_packed(group: h5py.Group, window: slice, parents: np.ndarray, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Heads (n, B, 3) metres and global rotations (n, B, 4) xyzw, float32, of a window of frames.

    Raises: ValueError if the stored arrays do not match these bones and frames.
    """
    bones = len(parents)
    offsets, moving = _attribute(group, _OFFSETS, "f"), _attribute(group, _MOVING, "i")
    inside = moving.ndim == 1 and 0 < len(moving) <= bones and bool(((moving >= 0) & (moving < bones)).all())
    if offsets.shape != (bones, 3) or not np.isfinite(offsets).all() or not inside:
        raise ValueError(f"{group.name} has places that do not belong to its {bones} bones")
    turns = _read(group, _TURNS, np.int16, window, (3 * bones, frames)).reshape(-1, bones, 3)
    places = _read(group, _PLACES, np.int32, window, (3 * len(moving), frames)).reshape(-1, len(moving), 3)
    local = Rotation.from_rotvec((turns * TURN_STEP_RAD).reshape(-1, 3)).as_quat().reshape(-1, bones, 4)
    hung = np.repeat(offsets[None].astype(np.float64), len(turns), axis=0)
    hung[:, moving] = places * PLACE_STEP_M
    heads, rotations = hung.copy(), local.copy()
    for level in _levels(parents):
        above = parents[level]
        parent = Rotation.from_quat(rotations[:, above].reshape(-1, 4))
        heads[:, level] = heads[:, above] + parent.apply(hung[:, level].reshape(-1, 3)).reshape(-1, len(level), 3)
        own = parent * Rotation.from_quat(local[:, level].reshape(-1, 4))
        rotations[:, level] = own.as_quat().reshape(-1, len(level), 4)
    return heads.astype(np.float32), _continuous(rotations).astype(np.float32)


def _in_parents(heads: np.ndarray, rotations: np.ndarray, parents: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation vectors (T, B, 3) int16, in steps, and places (T, B, 3) metres, in the parents' frames.

    Those of the root are in the world.
    """
    steps, hung = np.zeros(heads.shape, np.int16), heads.copy()
    kept: list[Rotation] = []
    for bone, parent in enumerate(parents):
        own = Rotation.from_quat(rotations[:, bone])
        above = kept[parent] if bone else None
        if above is not None:
            own = above.inv() * own
            # In the frame before quantisation: a place that is constant there stays constant.
            hung[:, bone] = Rotation.from_quat(rotations[:, parent]).inv().apply(heads[:, bone] - heads[:, parent])
        steps[:, bone] = np.rint(own.as_rotvec() / TURN_STEP_RAD)
        back = Rotation.from_rotvec(steps[:, bone] * TURN_STEP_RAD)
        kept.append(back if above is None else above * back)
    return steps, hung


def _levels(parents: np.ndarray) -> list[np.ndarray]:
    """Bones grouped by their distance from the root in the tree, nearest first, without the root."""
    depth = np.zeros(len(parents), np.int64)
    for bone in range(1, len(parents)):
        depth[bone] = depth[parents[bone]] + 1
    return [np.flatnonzero(depth == level) for level in range(1, int(depth.max(initial=0)) + 1)]


def _continuous(rotations: np.ndarray) -> np.ndarray:
    """The same rotations (T, B, 4), each with the sign that is nearer to the frame before."""
    turns_back = (rotations[1:] * rotations[:-1]).sum(-1) < 0
    flips = np.cumsum(turns_back, axis=0) % 2 == 1
    rotations[1:] = np.where(flips[..., None], -rotations[1:], rotations[1:])
    return rotations


def _write(group: h5py.Group, name: str, values: np.ndarray) -> None:
    """Store (T, C) integers as differences within each chunk, channel by channel."""
    apart = values.copy()
    apart[1:] = values[1:] - values[:-1]  # wraps
    apart[::CHUNK_FRAMES] = values[::CHUNK_FRAMES]
    across = np.ascontiguousarray(apart.T)
    chunks = (across.shape[0], min(CHUNK_FRAMES, across.shape[1]))
    group.create_dataset(
        name, data=across, chunks=chunks, compression="gzip", compression_opts=9, shuffle=True, fletcher32=True
    )


def _read(group: h5py.Group, name: str, kind: Any, window: slice, shape: tuple[int, int]) -> np.ndarray:
    """The window of (T, C) integers that `_write` stored; whole chunks are read and summed."""
    stored = group.get(name)
    if not isinstance(stored, h5py.Dataset) or stored.external or stored.is_virtual:
        raise ValueError(f"{group.name}/{name} is not an array within this file")
    if stored.shape != shape or stored.dtype != kind:
        raise ValueError(f"{group.name}/{name} is {stored.dtype} of the shape {stored.shape}, expected {shape}")
    check_stored_array(stored)
    first = window.start // CHUNK_FRAMES * CHUNK_FRAMES
    apart = np.asarray(stored[:, first : window.stop])
    pieces = [
        np.cumsum(apart[:, start : start + CHUNK_FRAMES], axis=1, dtype=kind)
        for start in range(0, apart.shape[1], CHUNK_FRAMES)
    ]
    return np.ascontiguousarray(np.concatenate(pieces, axis=1)[:, window.start - first :].T)


def _attribute(group: h5py.Group, name: str, kind: str) -> np.ndarray:
    value = np.asarray(group.attrs.get(name, ()))
    if value.dtype.kind != kind:
        raise ValueError(f"{group.name} lacks its {name}")
    return value
