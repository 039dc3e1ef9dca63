"""Bridges: the frames between two clips of one rig, filled by the models. Joining two clips, and looping one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from data_schemas.errors import InputError, UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.editing.edited import NONE, Edited
from stages.shared.editing.placing import Placement, placement_after
from stages.shared.editing.timing import resampled
from stages.shared.inference.cloud_sources import SynthesisedClouds
from stages.shared.inference.easing import ease_at_keys
from stages.shared.inference.filling import FillOptions, fill_motion
from stages.shared.inference.models import Models
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.kinematics.gap_speed import sentences_of_speed
from stages.shared.kinematics.rotations import continuous_signs
from stages.shared.solve.skeleton_pose import SkeletonPose

MOST_SECONDS = 10.0
SHORTEST_LOOP_S, LONGEST_LOOP_S = 0.1, 1.0
SMOOTH_SEAM = 1.2  # of the clip's usual change of velocity from frame to frame
SMOOTH_WITHIN = 2.0  # the same in the bridge itself; or what 95% of the clips' frames have, if that is more
_HIGH = 0.95
LAST_STEP_S = 0.2  # after a clip, in which the velocity comes from that of its last step
_LONGER = 1.5  # a loop whose seams are not smooth is tried again so much longer
_PACE = 1.5  # how much longer than at the clip's usual speed the way from its last to its first pose may take
_SAME_M = 1e-3


@dataclass(frozen=True)
class Seams:
    """How smoothly a bridge begins and ends.

    jumps_mps: (2,) mean over the body's joints of the change of velocity at the frames before and after the bridge.
    within_mps: the largest of the same in the frames of the bridge; 0 for a bridge without frames.
    usual_mps: the mean of the same over all frames of the clip or clips.
    high_mps:  95% of these frames have less.
    step_mps:  the mean speed of the body's joints over all frames.
    """

    jumps_mps: np.ndarray
    within_mps: float
    usual_mps: float
    high_mps: float
    step_mps: float

    @property
    def ratios(self) -> tuple[float, float]:
        """The larger change of velocity at the seams over the usual one, and the largest in the bridge over what a
        smooth one may have."""
        usual = max(self.usual_mps, 1e-9)
        return float(self.jumps_mps.max() / usual), float(self.within_mps / max(SMOOTH_WITHIN * usual, self.high_mps))

    @property
    def excess(self) -> float:
        """How many times as rough the bridge is as a smooth one may be; 1 or less is smooth."""
        seam, within = self.ratios
        return max(seam / SMOOTH_SEAM, within)


@dataclass(frozen=True)
class Bridged:
    """A motion with a bridge, where the clip after the bridge was put, and how smooth the bridge's ends are.

    speeds: sentences on speeds that people do not reach.
    """

    edited: Edited
    placement: Placement
    seams: Seams
    speeds: tuple[str, ...]


def looped(
    skeleton: Skeleton, motion: Motion, models: Callable[[], Models], *, seconds: float | None = None, seed: int = 0
) -> Bridged:
    """A clip with frames added that lead from its last pose to its first one, at its new place.

    The first pose is moved by the clip's own travel and turned by its own turn. The result, repeated with that
    travel and turn, is an endless motion.

    Args:
        models: loads the models that fill.
        seconds: time of the frames added. None: the time that the way takes at the clip's usual speed, 0.1 to 1 s;
            while the velocity changes by more than 1.2 times the clip's usual change at a seam, or in a frame added
            by more than twice the usual change and more than in 95% of the clip's frames, half as long again is
            tried, up to 1 s.

    Raises: UsageError for a time that is not above 0; InputError for a clip of fewer than 3 frames.
    """
    _check_has_speed(motion)
    if seconds is not None and not 0 < seconds <= MOST_SECONDS:
        raise UsageError(f"{seconds:g} s is not a time for a loop.", f"Give one above 0, up to {MOST_SECONDS:g} s.")
    if seconds is not None:
        return _looped(skeleton, motion, max(round(seconds * motion.fps), 1), models(), seed)
    count, most = _frames_of_way(skeleton, motion), max(round(LONGEST_LOOP_S * motion.fps), 1)
    loaded = models()
    tried = [_looped(skeleton, motion, count, loaded, seed)]
    while tried[-1].seams.excess > 1 and count < most:
        count = min(max(round(_LONGER * count), count + 1), most)
        tried.append(_looped(skeleton, motion, count, loaded, seed))
    return min(tried, key=lambda each: max(each.seams.excess, 1.0))  # of equally smooth ones the shortest


def _check_has_speed(motion: Motion) -> None:
    """Raise InputError for a clip too short to show how it moves at its ends."""
    if motion.frames < 3:
        shown = "1 frame" if motion.frames == 1 else f"{motion.frames} frames"
        raise InputError(f"A clip of {shown} has no speed at its ends.", "Give one of 3 or more.")


def _looped(skeleton: Skeleton, motion: Motion, count: int, models: Models, seed: int) -> Bridged:
    placement = placement_after(skeleton, motion, motion, (count + 1) / motion.fps)
    after = placement.of_motion(motion)
    bridge, seams, speeds = _bridge(skeleton, motion, after, count, models, seed)
    whole = _chained(motion, bridge)
    rows = np.concatenate([np.arange(motion.frames), np.full(count, NONE)])
    edited = Edited.of(whole, rows, bridged=rows == NONE)
    return Bridged(edited, placement, seams, speeds)


def joined(
    skeleton: Skeleton,
    first: Motion,
    second: Motion,
    models: Callable[[], Models],
    *,
    seconds: float = 0.5,
    seed: int = 0,
) -> Bridged:
    """Two clips of one skeleton, one after the other, with frames between them.

    The second one is turned and shifted on the ground, so that it goes on where the first one ends. At another rate
    than the first one's it is resampled.

    Args:
        models: loads the models that fill; not called where there is nothing to fill.
        seconds: time between the clips; 0 for none.

    Raises: UsageError for a time below 0; InputError for a clip of fewer than 3 frames.
    """
    if not 0 <= seconds <= MOST_SECONDS:
        raise UsageError(f"{seconds:g} s is not a time between two clips.", f"Give 0 to {MOST_SECONDS:g} s.")
    for clip in (first, second):
        _check_has_speed(clip)
    notes: tuple[str, ...] = ()
    rows_after = np.arange(second.frames)
    if abs(second.fps - first.fps) > 1e-6 * first.fps:
        notes = (f"The second clip has {second.fps:g} frames a second, and was resampled to {first.fps:g}.",)
        changed = resampled(skeleton, second, first.fps)
        second, rows_after = changed.motion, changed.rows
    second = replace(second, fps=first.fps)
    first, second = _same_tracks(skeleton, first, second)
    count = round(seconds * first.fps)
    placement = placement_after(skeleton, first, second, (count + 1) / first.fps)
    after = placement.of_motion(second)
    if count:
        bridge, seams, speeds = _bridge(skeleton, first, after, count, models(), seed)
    else:
        bridge, speeds = after.at(slice(0, 0)), ()
        seams = _seams(skeleton, _chained(first, after), (first.frames - 1, first.frames), (first, after))
    whole = _chained(first, bridge, after)
    like_after = np.where(rows_after == NONE, NONE, rows_after + first.frames)
    rows = np.concatenate([np.arange(first.frames), np.full(count + after.frames, NONE)])
    like = np.concatenate([np.arange(first.frames), np.full(count, NONE), like_after])
    bridged = np.zeros(whole.frames, bool)
    bridged[first.frames : first.frames + count] = True
    edited = Edited.of(whole, rows, like, placed=(rows == NONE) & (like >= 0), bridged=bridged, notes=notes)
    return Bridged(edited, placement, seams, speeds)


def check_one_rig(first: Skeleton, second: Skeleton, names: tuple[str, str]) -> None:
    """Raise InputError if two skeletons differ in joints, parents or lengths."""
    hint = f"Put it on that rig first: pumps retarget {names[1]} --to {names[0]} -o on_that_rig.bvh."
    if first.names != second.names or not np.array_equal(first.parents, second.parents):
        other = sorted(set(second.names) ^ set(first.names))
        what = f" ({', '.join(other[:3])}{', ...' if len(other) > 3 else ''})" if other else ""
        raise InputError(f"{names[1]} has another rig than {names[0]}: other joints{what}.", hint)
    away = np.linalg.norm(first.offsets - second.offsets, axis=1)
    if away.max() > _SAME_M:
        worst = first.names[int(away.argmax())]
        raise InputError(
            f"{names[1]} has another rig than {names[0]}: {worst} is {away.max() * 100:.1f} cm elsewhere.",
            hint,
        )


def _bridge(
    skeleton: Skeleton, before: Motion, after: Motion, count: int, models: Models, seed: int
) -> tuple[Motion, Seams, tuple[str, ...]]:
    """The frames between two clips, how smoothly they begin and end, and sentences on inhuman speeds."""
    reach = int(np.ceil(models.window * before.fps / MODEL_FPS))
    first, last = before.at(slice(-min(reach, before.frames), None)), after.at(slice(0, reach))
    gap = first.at(np.full(count, first.frames - 1))  # not read
    whole = _chained(first, gap, last)
    known = np.ones(whole.frames, bool)
    known[first.frames : first.frames + count] = False
    options = FillOptions(foot_lock=True)
    filled = fill_motion(
        skeleton, whole, known, SynthesisedClouds(models), seed=seed, device=models.autoencoder.device,
        options=options,
    ).motion  # fmt: skip
    # Holding feet may have brought back a part of the kinks that filling removed.
    pose = SkeletonPose.of_motion(skeleton, filled)
    eased = ease_at_keys(pose, known, filled.fps, options.ease_s)
    # At a high rate, the last step of a clip differs from the velocity that was taken over several of its steps.
    filled = ease_at_keys(eased, known, filled.fps, LAST_STEP_S, behind_s=0.0).motion(filled.fps)
    speeds = sentences_of_speed(skeleton, filled, np.flatnonzero(known), before.frames - first.frames)
    seams = _seams(skeleton, filled, (first.frames - 1, first.frames + count), (before, after))
    return filled.at(slice(first.frames, first.frames + count)), seams, tuple(speeds)


def _seams(skeleton: Skeleton, filled: Motion, frames: tuple[int, int], clips: tuple[Motion, Motion]) -> Seams:
    body = skeleton.groups >= 0
    places = positions_of(skeleton, filled)[:, body]
    bends = _bends(places[frames[0] - 1 : frames[1] + 2]).mean(axis=1) * filled.fps
    own = [positions_of(skeleton, clip)[:, body] for clip in clips]
    clips_own = np.concatenate([_bends(each).mean(axis=1) for each in own]) * filled.fps
    usual, high = float(clips_own.mean()), float(np.quantile(clips_own, _HIGH))
    steps = np.concatenate([np.linalg.norm(np.diff(each, axis=0), axis=-1).mean(axis=1) for each in own])
    within = float(bends[1:-1].max(initial=0.0))
    return Seams(bends[[0, -1]], within, usual, high, float(steps.mean() * filled.fps))


def _bends(places: np.ndarray) -> np.ndarray:
    """(T - 2, J) metres: by how much each step differs from the step before it."""
    return np.linalg.norm(np.diff(places, n=2, axis=0), axis=-1)


def _frames_of_way(skeleton: Skeleton, motion: Motion) -> int:
    """How many frames the way from the last pose to the first takes, at the clip's usual speed."""
    least, most = (max(round(seconds * motion.fps), 1) for seconds in (SHORTEST_LOOP_S, LONGEST_LOOP_S))
    after = placement_after(skeleton, motion, motion, 1 / motion.fps).of_motion(motion.at(slice(0, 3)))
    body = skeleton.groups >= 0
    whole = positions_of(skeleton, motion)
    places, pelvis = whole[:, body], whole[:, skeleton.root : skeleton.root + 1]
    moved = np.diff(places - pelvis, axis=0)
    usual = float(np.linalg.norm(moved, axis=-1).max(axis=1).mean())
    way = positions_of(skeleton, after)[0, body] - places[-1]
    return int(np.clip(round(_PACE * float(np.linalg.norm(way, axis=-1).max()) / max(usual, 1e-6)), least, most))


def _chained(*parts: Motion) -> Motion:
    """Motions of the same joints and rate one after the other, with continuous signs."""
    rotations = continuous_signs(np.concatenate([part.rotations for part in parts]))
    roots = np.concatenate([part.root_positions for part in parts])
    tracks = np.concatenate([part.tracks.reshape(part.frames, len(part.track_joints), 3) for part in parts])
    return Motion(rotations, roots, parts[0].fps, parts[0].track_joints, tracks)


def _same_tracks(skeleton: Skeleton, *motions: Motion) -> tuple[Motion, ...]:
    """The motions with a track for every joint that has one in any of them."""
    joints = sorted({int(joint) for motion in motions for joint in motion.track_joints})
    out = []
    for motion in motions:
        own = {int(joint): at for at, joint in enumerate(motion.track_joints)}
        tracks = np.zeros((motion.frames, len(joints), 3), np.float32)
        for at, joint in enumerate(joints):
            tracks[:, at] = motion.tracks[:, own[joint]] if joint in own else skeleton.offsets[joint]
        out.append(replace(motion, track_joints=np.array(joints, np.int32), tracks=tracks))
    return tuple(out)
