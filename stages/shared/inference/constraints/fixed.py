"""What a fill must not move, as arrays: known parts of frames, the pelvis' path, locked joints, pinned ends."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PchipInterpolator

from data_schemas.errors import InputError, UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.inference.constraints.asked import Constraints, Pin, RootPath
from stages.shared.inference.constraints.frame_ranges import parse_frames
from stages.shared.inference.constraints.known_parts import KnownParts, locked_joints
from stages.shared.inference.constraints.rig_parts import EndEffector, end_effector
from stages.shared.kinematics.forward_numpy import global_rotations, local_rotations, positions_of
from stages.shared.kinematics.rotations import continuous_signs, rotate, slerp

EXACT_M = 0.005  # a pinned end is at most so far from its place
MOST_M = 0.010  # the same where keys contradict the pin
PATH_M = 0.10  # the pelvis of a key may be so far from the path, which then goes through the key


@dataclass(frozen=True)
class PinnedEnd:
    """An end effector that stays at its place.

    limb: joints that move it. frames: (F,) rising. places: (F, 3) metres; None: where the end is.
    """

    name: str
    end: EndEffector
    limb: tuple[int, ...]
    frames: np.ndarray
    places: np.ndarray | None = None


@dataclass(frozen=True)
class Fixed:
    """What a fill of T frames must not move.

    joints: (T, J) bool, joints whose rotation in the parent's frame is the motion's.
    pelvis: (T, 3) metres, the pelvis' place on each axis; NaN where it is free.
    pins:   ends that stay at their places.
    """

    joints: np.ndarray
    pelvis: np.ndarray
    pins: tuple[PinnedEnd, ...] = ()

    def rows(self, rows: slice) -> Fixed:
        """Some of the frames."""
        pins = []
        for pin in self.pins:
            inside = (pin.frames >= rows.start) & (pin.frames < rows.stop)
            places = None if pin.places is None else pin.places[inside]
            pins.append(replace(pin, frames=pin.frames[inside] - rows.start, places=places))
        return Fixed(self.joints[rows], self.pelvis[rows], tuple(pin for pin in pins if len(pin.frames)))


def fixed_of(
    asked: Constraints, skeleton: Skeleton, motion: Motion, parts: KnownParts
) -> tuple[Motion, Fixed, list[str]]:
    """The motion with all values that are fixed, what is fixed, and notes on keys that contradict a path.

    Args:
        asked: the constraints. motion: T frames, of which `parts` are given. parts: of T frames.

    Raises: InputError for parts that the rig does not have, frames outside of the clip, and constraints that
        contradict the keys or each other; UsageError for what cannot be asked.
    """
    known = parts.whole
    places = positions_of(skeleton, motion)
    pelvis = np.where(parts.position[:, None], places[:, skeleton.root], np.nan)
    pelvis, notes = _with_path(asked.path, pelvis, parts.position, known)
    locked = locked_joints(asked.locks, skeleton, motion.frames) & ~parts.joints
    pins = tuple(_pinned(pin, skeleton, motion.frames) for pin in asked.pins)
    held = parts.joints | locked
    _check_pins(pins, skeleton, held, known)
    notes += _check_places(pins, places, motion.rotations.astype(np.float64), known)
    return _with_locks(skeleton, motion, parts.joints, locked), Fixed(held, pelvis, pins), notes


def _with_path(
    path: RootPath | None, pelvis: np.ndarray, given: np.ndarray, known: np.ndarray
) -> tuple[np.ndarray, list[str]]:
    """The pelvis' places with a path, which passes through the places that are given."""
    if path is None:
        return pelvis, []
    frames = np.array(path.frames)
    if frames[0] < 0 or frames[-1] >= len(pelvis):
        outside = frames[-1] if frames[-1] >= len(pelvis) else frames[0]
        raise InputError(
            f"The path names frame {outside}, but the clip has frames 0 to {len(pelvis) - 1}.", "Name its frames."
        )
    wanted = np.array(path.places, np.float64)
    axes = [0, 2] if wanted.shape[1] == 2 else [0, 1, 2]
    span = np.arange(frames[0], frames[-1] + 1)
    line = _curve(frames, wanted, span)
    own = given[span]
    kept = span[own & ~known[span]]
    if len(kept):
        raise InputError(
            f"The path and the place that is kept in frame {kept[0]} contradict each other.",
            "Leave out the path, or do not keep the position.",
        )
    off = np.where(own[:, None], pelvis[span][:, axes] - line, 0.0)
    distance = np.linalg.norm(off, axis=1)
    worst = int(distance.argmax())
    if distance[worst] > PATH_M:
        raise InputError(
            f"The path contradicts key {span[worst]}, whose pelvis is {distance[worst] * 100:.0f} cm away from it.",
            f"Move the path to within {PATH_M * 100:.0f} cm of the keys, or leave the key out.",
        )
    if own.any():
        line = line + np.stack([np.interp(span, span[own], off[own, axis]) for axis in range(len(axes))], -1)
    out = pelvis.copy()
    for column, axis in enumerate(axes):
        out[span, axis] = np.where(own, out[span, axis], line[:, column])
    notes = []
    if distance[worst] > MOST_M:
        notes.append(
            f"The path goes through the keys, up to {distance[worst] * 100:.1f} cm beside its own places "
            f"(key {span[worst]})."
        )
    return out, notes


def _curve(frames: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values (K, n) of rising frames at other frames between them: a monotone cubic, which does not overshoot."""
    if len(frames) == 1:
        return np.repeat(values, len(at), axis=0)
    return np.asarray(PchipInterpolator(frames, values, axis=0)(at))


def _with_locks(skeleton: Skeleton, motion: Motion, given: np.ndarray, locked: np.ndarray) -> Motion:
    """The motion with locked joints turning from one given frame of theirs to the next by slerp."""
    if not locked.any():
        return motion
    local = local_rotations(motion.rotations.astype(np.float64), skeleton.parents)
    frames = np.arange(motion.frames)
    for joint in np.flatnonzero(locked.any(axis=0)):
        keys = np.flatnonzero(given[:, joint])
        wanted = frames[locked[:, joint]]
        after = np.searchsorted(keys, wanted).clip(0, len(keys) - 1)
        before = np.where(keys[after] > wanted, after - 1, after).clip(0)
        step = np.maximum(keys[after] - keys[before], 1)
        share = ((wanted - keys[before]) / step).clip(0, 1)
        first, last = local[keys[before], joint], local[keys[after], joint]
        local[wanted, joint] = slerp(first, last, share[:, None])
    rotations = global_rotations(local, skeleton.parents)
    rotations /= np.linalg.norm(rotations, axis=-1, keepdims=True)
    return replace(motion, rotations=continuous_signs(rotations).astype(np.float32))


def _pinned(pin: Pin, skeleton: Skeleton, frames: int) -> PinnedEnd:
    what = f"pin {pin.end}:{pin.frames}"
    end = end_effector(skeleton, pin.end, what)
    limb = tuple(end.limb(skeleton))
    at = parse_frames(pin.frames, frames, what)
    if not limb:
        raise UsageError(f"{what}: no joint below the pelvis moves {pin.end}.", "Give --path for the pelvis.")
    places = None
    if pin.place is not None:
        places = np.tile(np.array(pin.place), (len(at), 1))
    elif pin.places is not None:
        if len(pin.places) != len(at):
            raise InputError(f"{what}: {len(at)} frames have {len(pin.places)} places.", "Give one for each frame.")
        places = np.array(pin.places)
    return PinnedEnd(pin.end, end, limb, at, places)


def _check_pins(pins: tuple[PinnedEnd, ...], skeleton: Skeleton, held: np.ndarray, known: np.ndarray) -> None:
    """Raises InputError where a joint is pinned twice, or a limb that is kept or locked shall follow a pin."""
    for number, pin in enumerate(pins):
        for other in pins[:number]:
            both = np.intersect1d(pin.frames, other.frames)
            if other.end.joint == pin.end.joint and len(both):
                raise InputError(f"{pin.name} is pinned twice in frame {both[0]}.", "Leave out one of the pins.")
        stiff = pin.frames[held[pin.frames][:, list(pin.limb)].all(axis=1) & ~known[pin.frames]]
        if len(stiff):
            raise InputError(
                f"{pin.name} is pinned in frame {stiff[0]}, but all joints of its limb are kept or locked there.",
                "Leave out the pin, or free a joint of the limb.",
            )


def _check_places(
    pins: tuple[PinnedEnd, ...], places: np.ndarray, rotations: np.ndarray, known: np.ndarray
) -> list[str]:
    """Notes on keys that are a little off a pin's place. Raises InputError where they are further off."""
    notes = []
    for pin in pins:
        keys = pin.frames[known[pin.frames]]
        if not len(keys):
            continue
        own = places[keys, pin.end.joint] + rotate(rotations[keys, pin.end.joint], pin.end.tail)
        wanted = place_of_keys(own) if pin.places is None else pin.places[known[pin.frames]]
        off = np.linalg.norm(own - wanted, axis=1)
        worst = int(off.argmax())
        if off[worst] > MOST_M:
            raise InputError(
                f"{pin.name} cannot stay at its place in frames {pin.frames[0]}-{pin.frames[-1]}: key {keys[worst]} "
                f"has it {off[worst] * 1000:.0f} mm away.",
                "Pin it between the keys, or leave the key out.",
            )
        if off[worst] > EXACT_M:
            notes.append(
                f"Keys contradict the pin of {pin.name}: it moves up to {off[worst] * 1000:.1f} mm from its place "
                f"to meet key {keys[worst]}."
            )
    return notes


def place_of_keys(places: np.ndarray) -> np.ndarray:
    """(3,) the place that lies nearest to the farthest of places (K, 3): the middle of their box."""
    return (places.min(axis=0) + places.max(axis=0)) / 2
