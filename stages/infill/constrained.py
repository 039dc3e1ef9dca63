"""Filling a file of which parts of frames are given: its request, its motion, and the columns that are kept."""

from __future__ import annotations

import numpy as np

from data_schemas.errors import InputError, UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.infill.config import Config
from stages.infill.request import Request, request_of
from stages.infill.row_files import RowFile
from stages.shared.formats.skeleton_map import SkeletonMap
from stages.shared.inference.constraints.asked import Constraints
from stages.shared.inference.constraints.constraint_files import read_constraints, read_path
from stages.shared.inference.constraints.fixed import Fixed, fixed_of
from stages.shared.inference.constraints.flags import constraints_of_flags
from stages.shared.inference.constraints.frame_ranges import parse_frames
from stages.shared.inference.constraints.known_parts import KnownParts, known_parts
from stages.shared.inference.keyframes import parse_keyframes
from stages.shared.kinematics.foot_contacts import LEGS


def constraints_of_config(config: Config) -> tuple[Constraints, list[str]]:
    """What flags and the file of constraints ask for, and notes on the file.

    Raises: UsageError, InputError for what cannot be read, and for what is given twice.
    """
    path = read_path(config.path) if config.path is not None else None
    asked = constraints_of_flags(config.keyframes, config.keep, config.pin, path, config.lock)
    if config.constraints is None:
        return asked, []
    read, notes = read_constraints(config.constraints)
    return asked.joined(read), notes


def request_in_parts(
    config: Config, asked: Constraints, file: RowFile, maps: tuple[SkeletonMap, ...]
) -> tuple[Request, KnownParts]:
    """The request, whose keys are the frames that are given as a whole, and what is given of each frame.

    The rig, which parts are named on, is found from the first and last keys alone.

    Raises: UsageError for options that contradict each other or where nothing is to be filled; InputError for parts
        that the rig does not have, and frames that are not in the file.
    """
    for option in ("transition", "times", "frames"):
        if getattr(config, option) is not None:
            raise UsageError(
                f"--{option} says which whole frames are keys, and parts of frames are given too.", "Use --keyframes."
            )
    skeleton, _, _ = file.key_motion(_whole_frames(asked, file.frames), maps)
    parts = known_parts(asked, skeleton, file.frames)
    if parts.whole.all() and config.predict is None:
        raise UsageError("No frame lies between the keys, so there is nothing to fill.", "Name fewer keys or parts.")
    keys = None if parts.whole.all() else ",".join(map(str, np.flatnonzero(parts.whole).tolist()))
    request = request_of(config.model_copy(update={"keyframes": keys}), file.frames, file.fps)
    return request, parts.longer(request.frames)


def _whole_frames(asked: Constraints, frames: int) -> np.ndarray:
    """Frames that are given as a whole whatever the rig is: keys of the whole body. Without these, the first and the
    last frame that is named for a part."""
    if asked.keyframes is not None:
        return parse_keyframes(asked.keyframes, frames)
    if not asked.parts:
        raise UsageError("Nothing says which frames are keys.", "Give --keyframes, such as every:15 or arms=0,15,40.")
    named = np.concatenate([parse_frames(part.frames, frames, f"keyframes {part.part}") for part in asked.parts])
    return np.unique([named.min(), named.max()])


def check_constraints(asked: Constraints, suffix: str) -> None:
    """Raises InputError where a file of another kind than BVH is filled in parts."""
    if asked.any and suffix != ".bvh":
        raise InputError(
            "Constraints by part, pins, paths and locks need a BVH, and the input holds a robot's angles.",
            "Fill it between whole keyframes.",
        )


def constrained_motion(
    skeleton: Skeleton, motion: Motion, request: Request, parts: KnownParts | None, asked: Constraints
) -> tuple[Motion, Fixed, list[str]]:
    """The motion of all frames of the output with what is given or fixed of it, what is fixed, and notes.

    Args:
        motion: of the file's rows where `parts` are given, else of the request's keys alone.

    Raises: as `fixed_of`.
    """
    known = np.isin(np.arange(request.frames), request.keys)
    if parts is None:
        whole = motion_of_keys(motion, request.keys, request.frames)
        parts = KnownParts.of_frames(known, skeleton.joints)
    else:
        whole = motion_of_keys(motion, np.arange(motion.frames), request.frames)
    made, fixed, notes = fixed_of(asked, skeleton, whole, parts)
    legs = np.isin(skeleton.groups, LEGS)
    legs_alone = parts.joints[:, legs].all(axis=1) & ~(parts.position & parts.joints[:, skeleton.root])
    if legs.any() and legs_alone.any():
        notes = [
            *notes,
            "The legs are kept where the pelvis is filled, so the feet move with it. Keep the root too.",
        ]
    return made, fixed, notes


def motion_of_keys(motion: Motion, keys: np.ndarray, frames: int) -> Motion:
    """A motion of so many frames, which has a motion's K frames as `keys` (K,); the others mean nothing."""
    rotations = np.zeros((frames, *motion.rotations.shape[1:]), np.float32)
    rotations[..., 3] = 1.0
    roots = np.zeros((frames, 3), np.float32)
    tracks = np.zeros((frames, *motion.tracks.shape[1:]), np.float32)
    rotations[keys], roots[keys] = motion.rotations, motion.root_positions
    if len(motion.track_joints):
        tracks[keys] = motion.tracks
    return Motion(rotations, roots, motion.fps, motion.track_joints, tracks)
