"""Smoothing a whole motion in time, with its first and last frame kept."""

from __future__ import annotations

import numpy as np

from data_schemas.errors import UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.editing.edited import NONE, Edited
from stages.shared.inference.denoising import motion_from, positions_in
from stages.shared.kinematics.forward_numpy import local_rotations_of
from stages.shared.kinematics.motion_filters import BUTTERWORTH_HZ, FILTERS, SAVGOL_S, filter_rotations

METHODS = ("savgol", "butterworth")


def smoothed(skeleton: Skeleton, motion: Motion, seconds: float, *, method: str = "savgol") -> Edited:
    """A motion averaged over about `seconds`; its first and last frame stay as they are.

    Args:
        method: "savgol" fits a polynomial of degree 3 over `seconds`; "butterworth" removes what takes less than
            about `seconds` to go back and forth.

    Raises: UsageError for another method, or a time that is not above 0.
    """
    if method not in METHODS:
        raise UsageError(f"{method!r} is not a way to smooth.", f"Give one of {', '.join(METHODS)}.")
    if not 0 < seconds <= 10:
        raise UsageError(f"{seconds:g} s is not a time to smooth over.", "Give one above 0, up to 10 s.")
    width = seconds / SAVGOL_S if method == "savgol" else seconds * BUTTERWORTH_HZ
    chosen = FILTERS[method]
    local = filter_rotations(local_rotations_of(skeleton, motion), motion.fps, chosen, width)
    places = chosen(positions_in(motion), motion.fps, width)
    made = motion_from(skeleton, motion, local, places)
    for end in (0, -1):
        made.rotations[end] = motion.rotations[end]
        made.root_positions[end] = motion.root_positions[end]
        if len(motion.track_joints):
            made.tracks[end] = motion.tracks[end]
    ends = np.zeros(motion.frames, bool)
    ends[[0, -1]] = True
    like = np.arange(motion.frames)
    return Edited.of(made, np.where(ends, like, NONE), like)
