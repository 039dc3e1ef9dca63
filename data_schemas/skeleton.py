"""The records that all packages use: a skeleton, and a motion of it.

Conventions (defined in `stages.shared.kinematics.conventions`): right-handed, Y up, metres, seconds, radians;
quaternions xyzw; J joints, T frames.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

BODY_GROUPS = ("spine", "left_arm", "right_arm", "left_leg", "right_leg")
NO_GROUP = -1


@dataclass(frozen=True)
class Skeleton:
    """A joint hierarchy with one bone per joint.

    names:   J joint names as the source spells them.
    parents: (J,) int32, parents before children, -1 for the file's root (joint 0).
    offsets: (J, 3) float64 metres, the joint's head in its parent's frame at rest. Joint 0: zeros.
    tails:   (J, 3) float64 metres, the bone's tail in the joint's own frame; zeros if there is no bone.
    groups:  (J,) int8 index into BODY_GROUPS, or NO_GROUP for joints that are not part of the body
             (joints above the pelvis, static props).
    sampled: (J,) bool, True if points are drawn on the bone (not fingers, face, twists, zero length).
    root:    index of the pelvis: the topmost joint of the body.
    unit_m:  metres in one unit of the source file.
    up_axis: "y" or "z", the up axis of the world that `header` is written for: the source's, or that of its rest pose
             if the format is not BVH and its rest pose stands along another axis than its motion.
    header:  text that is needed to write the source file back (a BVH's text up to MOTION, newlines as found), or "".
    """

    names: tuple[str, ...]
    parents: np.ndarray
    offsets: np.ndarray
    tails: np.ndarray
    groups: np.ndarray
    sampled: np.ndarray
    root: int
    unit_m: float = 1.0
    up_axis: str = "y"
    header: str = ""

    @property
    def joints(self) -> int:
        return len(self.names)


@dataclass(frozen=True)
class Motion:
    """A skeleton's motion.

    rotations:      (T, J, 4) float32 unit quaternions xyzw, GLOBAL, sign-continuous in time.
    root_positions: (T, 3) float32 metres, global position of joint 0 (the file's root, not always the pelvis).
    fps:            frames per second as used (after any override).
    track_joints:   (K,) int32 joints below joint 0 whose offset from the parent varies over time.
    tracks:         (T, K, 3) float32 metres, those joints' heads in their parent's frame, replacing `offsets`.
    """

    rotations: np.ndarray
    root_positions: np.ndarray
    fps: float
    track_joints: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))
    tracks: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 3), np.float32))

    @property
    def frames(self) -> int:
        return self.rotations.shape[0]

    def at(self, frames: slice | np.ndarray) -> Motion:
        """The motion of some of the frames, given by a slice or by their indices."""
        roots = self.root_positions[frames]
        # Without tracks the array may have fewer rows than there are frames.
        tracks = self.tracks[frames] if len(self.track_joints) else np.zeros((len(roots), 0, 3), np.float32)
        return replace(self, rotations=self.rotations[frames], root_positions=roots, tracks=tracks)
