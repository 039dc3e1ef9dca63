"""Segmented clips as sequences for networks: placed windows, their anchors, their transitions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data_schemas.concepts import ConceptsReader, StoredBody
from data_schemas.errors import InputError
from stages.shared.concepts.body_positions import heading_yaws
from stages.shared.kinematics.rotations import turned_about_y
from stages.shared.kinematics.spline_segments import spline_frames

LEAST_FRAMES = 8  # of a clip that is used


@dataclass(frozen=True)
class Placing:
    """Where a sequence was: `origin` (3,) of the pelvis in its first frame, and the yaw that made that frame face
    +Z.
    """

    origin: np.ndarray
    yaw: float

    def put(self, positions: np.ndarray) -> np.ndarray:
        """Positions (..., 3) of the world as seen from the first frame."""
        return turned_about_y(positions - self.origin, np.asarray(self.yaw))

    def back(self, positions: np.ndarray) -> np.ndarray:
        """The inverse of `put`."""
        return turned_about_y(positions, np.asarray(-self.yaw)) + self.origin


def placing_of(positions: np.ndarray, groups: np.ndarray) -> Placing:
    """The placing of a sequence (T, J, 3), by its first frame."""
    return Placing(positions[0, 0].copy(), float(heading_yaws(positions[:1], groups)[0]))


@dataclass(frozen=True)
class SegmentedSequence:
    """One clip: positions and the splines restored (T, J, 3), anchors (A,), their concepts (A,) counted over all
    actions (-1 for none), the index of its action."""

    clip: str
    positions: np.ndarray
    restored: np.ndarray
    anchors: np.ndarray
    concepts: np.ndarray
    action: int
    split: str


@dataclass(frozen=True)
class ConceptSet:
    """All sequences of one artefact with the actions and concepts that they have in common.

    actions: their names. centres: (C, J, 3) anchor concepts of all actions; action_of: (C,). fps: of all clips.
    """

    sequences: tuple[SegmentedSequence, ...]
    actions: tuple[str, ...]
    centres: np.ndarray
    action_of: np.ndarray
    body: StoredBody
    fps: float

    def of(self, split: str) -> list[SegmentedSequence]:
        return [each for each in self.sequences if each.split == split]


def concept_set(reader: ConceptsReader, actions: Sequence[str] = ()) -> ConceptSet:
    """The clips with a known action.

    Args:
        actions: those to take; () for all.

    Raises: InputError if the artefact holds several bodies or rates, no anchor concepts, or none of the actions.
    """
    bodies, rates = {row.skeleton for row in reader.clips}, {row.fps for row in reader.clips}
    if len(bodies) != 1 or len(rates) != 1:
        raise InputError(
            f"{reader.artefact.path} holds {len(bodies)} sets of joints at {len(rates)} rates, and one is learned.",
            "Put the motions on one rig (`pumps data rerig`), and segment them with --fps 20.",
        )
    centres = {name: poses for name, poses in reader.centres().items() if not actions or name in actions}
    if not centres:
        known = ", ".join(reader.centres()) or "none"
        raise InputError(
            f"{reader.artefact.path} has no anchor concepts of {', '.join(actions) or 'any action'}, only {known}.",
            "Segment with --cluster kmeans.",
        )
    names = tuple(sorted(centres))
    first = dict(zip(names, np.cumsum([0, *(len(centres[name]) for name in names)]).tolist(), strict=False))
    found = []
    for row in reader.clips:
        if row.frames < LEAST_FRAMES or reader.action(row.clip) not in first:
            continue
        clip = reader.segmented(row.clip)
        restored = spline_frames(clip.splines.astype(np.float64), clip.anchors).astype(np.float32)
        concepts = np.where(clip.clusters >= 0, clip.clusters + first[clip.action], -1)
        found.append(
            SegmentedSequence(
                row.clip, clip.positions, restored, clip.anchors, concepts, names.index(clip.action), row.split
            )
        )
    return ConceptSet(
        tuple(found),
        names,
        np.concatenate([centres[name] for name in names]),
        np.repeat(np.arange(len(names)), [len(centres[name]) for name in names]),
        reader.body(next(iter(bodies))),
        next(iter(rates)),
    )


@dataclass(frozen=True)
class SegmentArrays:
    """The transitions of a sequence of T frames: of_frame (T,), times (T,) 0 to 1, first and last (S,) frames."""

    of_frame: np.ndarray
    times: np.ndarray
    first: np.ndarray
    last: np.ndarray


def segment_arrays(anchors: np.ndarray, frames: int) -> SegmentArrays:
    """Of anchors (A,) that rise from 0 to `frames` - 1; each anchor belongs to the transition after it, the last one
    to the one before it."""
    if len(anchors) < 2:
        none = np.zeros(1, np.int64)
        return SegmentArrays(np.zeros(frames, np.int64), np.zeros(frames), none, none)
    first, last = anchors[:-1].astype(np.int64), anchors[1:].astype(np.int64)
    of_frame = np.clip(np.searchsorted(anchors, np.arange(frames), side="right") - 1, 0, len(first) - 1)
    times = (np.arange(frames) - first[of_frame]) / np.maximum(last - first, 1)[of_frame]
    return SegmentArrays(of_frame, times, first, last)
