"""A motion with its skeleton, as arrays."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from data_schemas import skeleton as records
from pumps import editing


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion on its skeleton: T frames, J joints. Immutable; functions of pumps return new ones.

    Arrays are right-handed, Y up, in metres and seconds; quaternions are xyzw. They are read-only.

    Attributes:
        skeleton: the joints, their offsets and body groups, and what is needed to write the source's header again.
        record: rotations and places as pumps stores them.
        name: the clip's name.
        notes: what was odd in the file, one sentence each.
        licence: the source's licence, where known.
        up_axis: the up axis of the source's world, "y" or "z", if `load` was given it.
        source: the BVH that this motion was read from or filled into, verbatim.
    """

    skeleton: records.Skeleton
    record: records.Motion
    name: str = "motion"
    notes: tuple[str, ...] = ()
    licence: str = ""
    up_axis: str | None = None
    source: bytes = field(default=b"", repr=False)

    @property
    def frames(self) -> int:
        """T."""
        return self.record.frames

    @property
    def fps(self) -> float:
        """Frames per second."""
        return self.record.fps

    @property
    def seconds(self) -> float:
        """T / fps."""
        return self.frames / self.fps

    @property
    def names(self) -> tuple[str, ...]:
        """J joint names, as the file spells them."""
        return self.skeleton.names

    @cached_property
    def parents(self) -> np.ndarray:
        """(J,) int32, -1 for joint 0; parents come before children."""
        return _read_only(self.skeleton.parents)

    @cached_property
    def offsets(self) -> np.ndarray:
        """(J, 3) float64 metres: each joint in its parent's frame at rest."""
        return _read_only(self.skeleton.offsets)

    @cached_property
    def rotations(self) -> np.ndarray:
        """(T, J, 4) float32 unit quaternions xyzw, global, without jumps of sign."""
        return _read_only(self.record.rotations)

    @cached_property
    def local_rotations(self) -> np.ndarray:
        """(T, J, 4) float64 unit quaternions xyzw, each in its parent's frame."""
        from stages.shared.kinematics.forward_numpy import local_rotations_of

        return _read_only(local_rotations_of(self.skeleton, self.record))

    @cached_property
    def positions(self) -> np.ndarray:
        """(T, J, 3) float64 metres: the joints in the world."""
        from stages.shared.kinematics.forward_numpy import positions_of

        return _read_only(positions_of(self.skeleton, self.record))

    def trim(self, first: int, stop: int | None = None) -> Motion:
        """Frames `first` to `stop - 1`, to the end where `stop` is None; negative numbers count from the end.

        Raises:
            InputError: frames that are not in the motion.
        """
        return editing.trim(self, first, stop)

    def resample(self, fps: float) -> Motion:
        """The motion at another rate; poses at times that both rates have stay value for value.

        Raises:
            UsageError: a rate that is not above 0.
        """
        return editing.resample(self, fps)

    def mirror(self, across: str = "auto") -> Motion:
        """The motion with left and right exchanged, on the same skeleton.

        Args:
            across: "x" or "z", the axis along which the world is mirrored; "auto" for the one from the body's left to
                its right at rest.

        Raises:
            InputError: a skeleton without pairs of joints.
        """
        return editing.mirror(self, across)

    def smooth(self, seconds: float = 0.3, *, method: str = "savgol") -> Motion:
        """The motion averaged over about so many seconds, by "savgol" or "butterworth"; both ends stay."""
        return editing.smooth(self, seconds, method)

    def loop(
        self,
        seconds: float | None = None,
        *,
        weights: str | os.PathLike[str] | None = None,
        seed: int = 0,
        device: str = "auto",
    ) -> Motion:
        """The motion with frames added that lead to its first pose at its new place, so that it can be repeated.

        Args:
            seconds: of the frames added; None to find a time. weights, seed, device: as of `pumps.infill`.

        Raises:
            InputError: a motion of fewer than 3 frames.
        """
        return editing.loop(self, seconds, weights, seed, device)

    def join(
        self,
        then: Motion,
        seconds: float = 0.5,
        *,
        weights: str | os.PathLike[str] | None = None,
        seed: int = 0,
        device: str = "auto",
    ) -> Motion:
        """This motion, filled frames, and a second motion of the same rig, put where this one ends.

        Args:
            seconds: of the frames between the two; 0 for none. weights, seed, device: as of `pumps.infill`.

        Raises:
            InputError: a motion of another rig, which `pumps.retarget` puts on this one.
        """
        return editing.join(self, then, seconds, weights, seed, device)


def _read_only(values: np.ndarray) -> np.ndarray:
    view = values.view()
    view.flags.writeable = False
    return view
