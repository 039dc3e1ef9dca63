"""Which parts of which frames a file gives: resolved on a rig and a clip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data_schemas.errors import UsageError
from data_schemas.skeleton import Skeleton
from stages.shared.inference.constraints.asked import Constraints, PartFrames
from stages.shared.inference.constraints.frame_ranges import parse_frames
from stages.shared.inference.constraints.rig_parts import POSITION, ROOT, rig_part
from stages.shared.inference.keyframes import parse_keyframes


@dataclass(frozen=True)
class KnownParts:
    """What is given of T frames.

    joints: (T, J) bool, joints whose rotations are given. position: (T,) bool, where the pelvis' place is given.
    """

    joints: np.ndarray
    position: np.ndarray

    @classmethod
    def none(cls, frames: int, joints: int) -> KnownParts:
        """Nothing is given."""
        return cls(np.zeros((frames, joints), bool), np.zeros(frames, bool))

    @classmethod
    def of_frames(cls, known: np.ndarray, joints: int) -> KnownParts:
        """Whole frames (T,) are given."""
        return cls(np.repeat(known[:, None], joints, axis=1), known.copy())

    @property
    def whole(self) -> np.ndarray:
        """(T,) bool, frames of which everything is given."""
        return np.asarray(self.joints.all(axis=1)) & self.position

    def with_part(self, part: PartFrames, skeleton: Skeleton, what: str) -> KnownParts:
        """The same, and a part in its frames."""
        own = rig_part(skeleton, part.part, what)
        at = parse_frames(part.frames, len(self.position), what)
        joints, position = self.joints.copy(), self.position.copy()
        joints[np.ix_(at, np.flatnonzero(own.joints))] = True
        position[at] |= own.position
        return KnownParts(joints, position)

    def with_ends(self) -> KnownParts:
        """The same, with each part also given before its first frame and after its last one, where files stay as they
        are. Nothing is added to frames before the first or after the last frame that is given of any part."""
        table = np.column_stack([self.joints, self.position])
        named = np.flatnonzero(table.any(axis=1))
        begun = np.maximum.accumulate(table, axis=0)
        unfinished = np.maximum.accumulate(table[::-1], axis=0)[::-1]
        table = table | ~begun | ~unfinished
        table[: named[0]] = table[named[-1] + 1 :] = False
        return KnownParts(table[:, :-1], table[:, -1])

    def rows(self, rows: slice) -> KnownParts:
        """Some of the frames."""
        return KnownParts(self.joints[rows], self.position[rows])

    def longer(self, frames: int) -> KnownParts:
        """With frames added at the end, of which nothing is given."""
        more = frames - len(self.position)
        return KnownParts(np.pad(self.joints, ((0, more), (0, 0))), np.pad(self.position, (0, more)))


def known_parts(asked: Constraints, skeleton: Skeleton, frames: int) -> KnownParts:
    """What is given of a clip of T frames.

    If frames of the whole body are named, they are given, and of each part also the frames that are named for it.
    Otherwise parts that are not named as keyframes keep all their frames.

    Raises: UsageError where nothing says which frames are keys; InputError for parts that the rig does not have and
        frames that are not in the clip.
    """
    if asked.keyframes is None and not asked.parts:
        raise UsageError("Nothing says which frames are keys.", "Give --keyframes, such as every:15 or arms=0,15,40.")
    found = KnownParts.none(frames, skeleton.joints)
    if asked.keyframes is not None:
        at = np.zeros(frames, bool)
        at[parse_keyframes(asked.keyframes, frames)] = True
        found = KnownParts.of_frames(at, skeleton.joints)
    for part in asked.parts:
        found = found.with_part(part, skeleton, f"keyframes {part.part}={part.frames}")
    if asked.keyframes is None:
        found = KnownParts(
            found.joints | ~found.joints.any(axis=0),
            found.position if found.position.any() else np.ones(frames, bool),
        )
    for part in asked.keep:
        found = found.with_part(part, skeleton, f"keep {part.part}:{part.frames}")
    return found.with_ends()


def locked_joints(locks: Sequence[PartFrames], skeleton: Skeleton, frames: int) -> np.ndarray:
    """(T, J) bool, joints that the models shall not move.

    Raises: UsageError for a lock of the pelvis' place; InputError as `known_parts`.
    """
    found = KnownParts.none(frames, skeleton.joints)
    for part in locks:
        what = f"lock {part.part}:{part.frames}"
        if {POSITION, ROOT, "lower_body"} & {name.strip() for name in part.part.split(",")}:
            raise UsageError(f"{what}: a lock holds joints' rotations, not a place.", "Give --path for the pelvis.")
        found = found.with_part(part, skeleton, what)
    return found.joints
