"""Which frames a motion has, and at which times: trimming and resampling."""

from __future__ import annotations

import re

import numpy as np
import torch

from data_schemas.errors import InputError, UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.editing.edited import NONE, Edited
from stages.shared.inference.keyframes import parse_keyframes
from stages.shared.kinematics.resampling import resampled_frames
from stages.shared.kinematics.rotations import continuous_signs
from stages.shared.solve.skeleton_pose import SkeletonPose

MOST_FPS = 10_000.0
MOST_FRAMES = 10_000_000
_COMMON = 1e-4  # frames; times nearer than this to a frame of the input are that frame's
_BLOCK_FRAMES = 4096  # made at a time, so that memory does not grow with the clip
_BESIDE = 3  # frames beside a block that the tangents at its ends depend on
_TIME = r"(?:[0-9]{1,9}(?:\.[0-9]{1,30})?|\.[0-9]{1,30})"
_SECONDS = re.compile(rf"({_TIME})?\s{{0,9}}:\s{{0,9}}({_TIME})?")


def trimmed(motion: Motion, frames: np.ndarray) -> Edited:
    """Only the given frames (N,) of a motion, rising. Raises InputError if there is none."""
    if len(frames) == 0:
        raise InputError("No frame is left.", f"The clip has frames 0 to {motion.frames - 1}.")
    return Edited.of(motion.at(frames), frames)


def range_of_frames(text: str, frames: int) -> np.ndarray:
    """The frames (N,) of a range such as `10:50` (without 50), `10:` or `:-5`.

    Raises: UsageError if the text is no range of frames without a step; InputError if it goes beyond the clip.
    """
    if text.count(":") != 1 or "," in text or "every" in text:
        raise UsageError(f"{text!r} is not a range of frames.", "Write it as first:stop, such as 10:50, 10: or :-5.")
    return parse_keyframes(text, frames)


def range_of_seconds(text: str, frames: int, fps: float) -> np.ndarray:
    """The frames (N,) of a range of times such as `0.5:2`, from the first time on up to, and without, the second.

    Raises: UsageError if the text is no range; InputError if no frame of the clip lies in it, or it goes beyond it.
    """
    match = _SECONDS.fullmatch(text.strip())
    if match is None:
        raise UsageError(f"{text!r} is not a range of seconds.", "Write it as first:stop, such as 0.5:2 or 1:.")
    first = float(match[1]) if match[1] else 0.0
    stop = float(match[2]) if match[2] else frames / fps
    if stop > frames / fps + 1e-6:
        raise InputError(f"The clip ends at {frames / fps:.3f} s, before {stop:g} s.", "Name an earlier time.")
    times = np.arange(frames) / fps
    chosen = np.flatnonzero((times > first - _COMMON / fps) & (times < stop - _COMMON / fps))
    if len(chosen) == 0:
        raise InputError(f"No frame of the clip lies from {first:g} s to {stop:g} s.", "Name a longer range.")
    return chosen


def resampled(skeleton: Skeleton, motion: Motion, fps: float) -> Edited:
    """A motion at another rate. Poses at times at which the input has a frame are that frame's, value for value.

    The others lie on the curve without kinks through the input's frames (`interpolate_pose`). No low-pass comes
    before a lower rate, unlike in `stages.shared.kinematics.resampling.resample`: it would change every frame.

    Raises: UsageError if the rate is not above 0, or asks for more frames than can be.
    """
    if not 0 < fps <= MOST_FPS:
        raise UsageError(f"{fps:g} frames a second is not a rate.", f"Give one above 0, up to {MOST_FPS:g}.")
    count = resampled_frames(motion.frames, motion.fps, fps)
    if count > MOST_FRAMES:
        raise UsageError(f"At {fps:g} frames a second the clip would have {count} frames.", "Give a lower rate.")
    times = np.minimum(np.arange(count) * (motion.fps / fps), motion.frames - 1)
    nearest = np.rint(times).astype(np.int64)
    common = np.abs(times - nearest) < _COMMON
    made = motion.at(nearest)  # indexed by an array: a copy
    rotations, roots, tracks = made.rotations, made.root_positions, made.tracks
    for start in range(0, count, _BLOCK_FRAMES):
        new = np.flatnonzero(~common[start : start + _BLOCK_FRAMES]) + start
        if len(new) == 0:
            continue
        low = max(int(times[new[0]]) - _BESIDE, 0)
        high = min(int(times[new[-1]]) + 2 + _BESIDE, motion.frames)
        keys = SkeletonPose.of_motion(skeleton, motion.at(slice(low, high))).by_local()
        found = keys.at(
            torch.arange(high - low, dtype=torch.float64), torch.as_tensor(times[new] - low), smooth=1.0
        ).motion(fps)
        rotations[new], roots[new] = found.rotations, found.root_positions
        if len(motion.track_joints):
            tracks[new] = found.tracks
    notes = () if common.all() else (f"{int(common.sum())} of {count} frames are frames of the input, unchanged.",)
    result = Motion(continuous_signs(rotations), roots, float(fps), motion.track_joints, tracks)
    return Edited.of(result, np.where(common, nearest, NONE), nearest, notes=notes)
