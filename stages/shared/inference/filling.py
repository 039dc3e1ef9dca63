"""Fill a motion between its keys.

    start   the keys as poses, and their plain interpolation (the base) at 30 frames a second and at the keys' times
    1 find  clouds: points that ride on the base, and where the models think that the same points should be
    2 solve the *difference* of the two clouds carries the base's points, and the joints follow the points; the
            corrections, zero at every key, are brought to the clip's own frames
    3 finish: take the kinks from the keys, hold the feet that stand

Only the difference between two decodings counts, and what is left of it at the keys is taken off: whatever the
networks get wrong in the same way for both costs nothing. Every step takes and gives poses (`SkeletonPose`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from data_schemas.errors import InputError, UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.inference.cloud_interfaces import Clouds, CloudSource, Drawing, Scene
from stages.shared.inference.clouds import BLOCK_TOKENS, CHUNK_TOKENS
from stages.shared.inference.confidence import Confidence, trust_of
from stages.shared.inference.constraints.fixed import Fixed
from stages.shared.inference.easing import ease_at_keys
from stages.shared.inference.filled import Filled, measured_fill, nothing_to_fill
from stages.shared.inference.foot_lock import lock_feet
from stages.shared.inference.partly_known import STIFF, PartlyKnown
from stages.shared.inference.pinned_ends import pin_ends
from stages.shared.inference.token_times import choose_tokens
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.foot_contacts import has_feet
from stages.shared.kinematics.frame_blocks import blocks_of
from stages.shared.kinematics.plain_interpolation import damped_smoothness, interpolate_values
from stages.shared.kinematics.rotations import matrices
from stages.shared.kinematics.runs import widened_to_keys
from stages.shared.solve.key_prior import turn_prior
from stages.shared.solve.skeleton_pose import SkeletonPose
from stages.shared.solve.smoothing import bends_of_positions, bends_of_rotations, smooth_corrections
from stages.shared.solve.solving import Corrections, SolveOptions, solve_pose

_CURVES_AT_ONCE = 12  # numbers of a pose that are computed over all frames together: bounds the memory of a long clip


@dataclass(frozen=True)
class FillOptions:
    """Numbers to tune on validation data.

    solve:       strength of the solve's prior.
    base_smooth: 0 starts from slerp, 1 from the cubic through the keys; None from the damped cubic, as in training.
    smooth_span: the motion is smoothed in time over about this many model frames between its keys (0: not at all).
    turn_floor_rad: what a joint's correction is worth nothing below, root mean square over a gap; larger ones shrink
                 by what this leaves of their power (James and Stein), so that where the base is right it stays.
    shift_floor_m: the same of the pelvis' shift.
    trust:       corrections are multiplied by this; 0 gives the base.
    give_up_m:   a gap whose points are left this far from their targets, on average, falls back to the base.
    ease_s:      what a gap's velocity lacks at a key is lent to its frames over so long, seconds (0: not at all).
    foot_lock:   hold feet that stand where they stand, on a skeleton with two legs.
    sigma_m:     spread of the cloud around the bones.
    views:       how often the networks see the clip, turned and mirrored (`Drawing`).
    """

    solve: SolveOptions = field(default_factory=SolveOptions)
    base_smooth: float | None = None
    smooth_span: float = 1.5
    turn_floor_rad: float = 0.03
    shift_floor_m: float = 0.004
    trust: float = 1.0
    give_up_m: float = 0.25
    ease_s: float = 0.4
    foot_lock: bool = False
    sigma_m: float = 0.05
    views: int = 4


# Points without error: believe them.
TRUE_CLOUD = FillOptions(
    solve=SolveOptions(point_noise_m=0.02), smooth_span=0.0, turn_floor_rad=0.0, shift_floor_m=0.0, ease_s=0.0
)


class Start(NamedTuple):
    """What a fill starts from.

    given: the T frames of the motion, of which only the known ones are read.
    keys:  the known ones, and base: their plain interpolation at the others, the gaps' frames.
    scene: the same at the times at which models and solve see the clip.
    gap_times: (M,) when the gaps' frames are, in model frames.
    parts: what is given beside whole keys; None where that is nothing.
    """

    given: SkeletonPose
    keys: SkeletonPose
    base: SkeletonPose
    scene: Scene
    gap_times: Tensor
    parts: PartlyKnown | None = None


class Solved(NamedTuple):
    """pose: all T frames, the gaps' corrected. plain: (T, J) True where a gap's joint was left as the base has it."""

    pose: SkeletonPose
    plain: np.ndarray


class _Applied(NamedTuple):
    """Corrections as applied at the tokens: turns (N, J, 3) radians, shifts (N, 3) metres, (N, J) True: fell back."""

    turns: Tensor
    shifts: Tensor
    fallen: np.ndarray


def fill_motion(
    skeleton: Skeleton,
    motion: Motion,
    known: np.ndarray,
    source: CloudSource,
    *,
    points: int = 256,
    seed: int = 0,
    device: torch.device | str = "cpu",
    options: FillOptions | None = None,
    fixed: Fixed | None = None,
) -> Filled:
    """Fill the frames of a motion that are not known.

    Args:
        motion: T frames, of which only the known ones are read, and in the others what `fixed` says.
        known: (T,) bool, True where the frame is given.
        source: where clouds come from: `SynthesisedClouds(models)` fills; the others measure its parts.
        points: size of the cloud.
        seed: of the points' places and identities; the same seed gives the same motion.
        options: None takes the defaults for decoded clouds, or `TRUE_CLOUD` where the source's points are exact.
        fixed: what must not move in frames that are not known, and ends that stay at their places.

    Raises: UsageError where arguments do not belong together; InputError where no frame is known or no bone is seen.
    """
    options = options or (TRUE_CLOUD if source.exact else FillOptions())
    _check(skeleton, motion, known)
    known, fps = np.asarray(known, bool), motion.fps
    if known.all():
        return nothing_to_fill(motion)
    solved, base, wander_m, parts = _solved(skeleton, motion, known, source, points, seed, device, options, fixed)
    # 3: finish
    eased = eased_pose(solved.pose, parts, known, fps, options)
    plain = solved.plain
    del solved  # of a long clip every pose takes much memory
    return held_fill(eased, plain, known, fps, options, fixed, base=base, wander_m=wander_m)


def eased_pose(
    pose: SkeletonPose, parts: PartlyKnown | None, known: np.ndarray, fps: float, options: FillOptions
) -> SkeletonPose:
    """A filled pose without kinks at the keys."""
    if parts is None:
        return ease_at_keys(pose, known, fps, options.ease_s)
    return parts.eased(pose, fps, options.ease_s)


def held_fill(
    eased: SkeletonPose,
    plain: np.ndarray,
    known: np.ndarray,
    fps: float,
    options: FillOptions,
    fixed: Fixed | None,
    *,
    base: SkeletonPose,
    wander_m: float,
) -> Filled:
    """A filled pose with its feet held and its ends pinned, measured beside the plain interpolation `base`; `plain`
    and `wander_m` as `Filled` has them."""
    stiff = None if fixed is None else fixed.joints
    held = lock_feet(eased, known, fps, stiff) if options.foot_lock and has_feet(eased.skeleton) else eased
    off_m: dict[str, float] = {}
    if fixed is not None:
        held, off_m = pin_ends(held, fixed, known, fps)
    made = measured_fill(known, fps, held, plain, loose=eased, base=base, wander_m=wander_m)
    return replace(made, pins_off_m=off_m)


def _solved(
    skeleton: Skeleton,
    motion: Motion,
    known: np.ndarray,
    source: CloudSource,
    points: int,
    seed: int,
    device: torch.device | str,
    options: FillOptions,
    fixed: Fixed | None,
) -> tuple[Solved, SkeletonPose, float, PartlyKnown | None]:
    """Steps 1 and 2: the corrected clip, the plain interpolation, how far points stray in their bones' frames, and
    what is given in part."""
    start = start_from(skeleton, motion, known, source, device=device, options=options, fixed=fixed)
    with torch.no_grad():
        # 1: find
        clouds = find_clouds(start, source, points=points, seed=seed, options=options)
        # 2: solve
        corrections = solve_clouds(start, clouds, options.solve)
        solved = apply_corrections(start, corrections, known, options, source.confidence)
    base = start.given.with_rows(np.flatnonzero(~known), start.base)
    return solved, base, float(clouds.binding.wander.nanmedian()), start.parts


def _check(skeleton: Skeleton, motion: Motion, known: np.ndarray) -> None:
    if np.shape(known) != (motion.frames,):
        raise UsageError(f"`known` has shape {np.shape(known)}, but the motion has {motion.frames} frames.")
    if not np.any(known):
        raise InputError("No frame of the motion is known, so there is nothing to fill from.", "Give a keyframe.")
    if not np.any(skeleton.sampled):
        raise InputError("The skeleton has no bone that a point cloud can see.", "Look at it with pumps inspect.")


def start_from(
    skeleton: Skeleton,
    motion: Motion,
    known: np.ndarray,
    source: CloudSource,
    *,
    device: torch.device | str = "cpu",
    options: FillOptions,
    fixed: Fixed | None = None,
) -> Start:
    """The keys as poses, and their plain interpolation; arguments as of `fill_motion`, with a frame missing."""
    keys, gaps = np.flatnonzero(known), np.flatnonzero(~known)
    given = SkeletonPose.of_motion(skeleton, motion)
    key_pose = given.rows(keys).by_local().to(device)
    tokens = choose_tokens(keys, motion.frames, motion.fps)
    key_times, gap_times = (torch.as_tensor(f * (MODEL_FPS / motion.fps), device=device) for f in (keys, gaps))
    smooth = damped_smoothness(key_times, MODEL_FPS) if options.base_smooth is None else options.base_smooth
    glide = None if source.glide is None else source.glide.in_frames(MODEL_FPS)
    if fixed is not None:
        parts = PartlyKnown.of(fixed, known, given)
        token_times = torch.as_tensor(tokens.times, device=device)
        with torch.no_grad():
            at_tokens, at_gaps = parts.bases(key_pose, given, motion.fps, glide, token_times, gap_times)
        return Start(given, key_pose, at_gaps, Scene(tokens, at_tokens), gap_times, parts)
    scene = Scene(tokens, key_pose.at(key_times, torch.as_tensor(tokens.times, device=device), smooth, glide))
    with torch.no_grad():
        return Start(given, key_pose, key_pose.at(key_times, gap_times, smooth, glide), scene, gap_times)


# ---- 1: find clouds -----------------------------------------------------------------------------------------------


def find_clouds(start: Start, source: CloudSource, *, points: int, seed: int, options: FillOptions) -> Clouds:
    """Where points should be, and where the same points are on the base."""
    return source.find(start.scene, Drawing(points, options.sigma_m, options.views, seed))


# ---- 2: solve -----------------------------------------------------------------------------------------------------


def solve_clouds(start: Start, clouds: Clouds, options: SolveOptions) -> Corrections:
    """Corrections to the base at the tokens, as the clouds ask for them, neither shrunk nor smoothed.

    The base's bound points are carried by the clouds' difference, less what the difference is at the keys.
    """
    scene, binding, is_key = start.scene, clouds.binding, start.scene.tokens.is_key
    # What a joint did not do over the keys, noise in the points does not make it do between them.
    prior = turn_prior(start.keys.local, options.turn_prior_rad)
    if start.parts is not None:
        prior[start.parts.stiff] = STIFF * torch.eye(3, device=prior.device)
    made: Tensor | None = None
    seen = prior.new_zeros(0)
    for block in _blocks_to_solve(is_key):
        targets = _targets_of(scene, clouds, block[0].start, block[-1].stop)
        for rows in block:
            parts, skeleton = scene.base.rows(rows).parts, scene.skeleton
            found = solve_pose(targets(rows), binding, *parts, skeleton.parents, skeleton.root, options, prior)
            if made is None:
                seen, made = found.seen, scene.base.held.new_zeros(len(is_key), 3 * len(found.seen) + 4)
            made[rows] = torch.cat([found.turns.flatten(1), found.shifts, found.residual.unsqueeze(-1)], -1)
    assert made is not None  # `_blocks_to_solve` gives one run at least
    return Corrections(made[:, :-4].unflatten(-1, (-1, 3)), made[:, -4:-1], seen, made[:, -1])


def _blocks_to_solve(is_key: np.ndarray) -> list[list[slice]]:
    """Runs of tokens that are solved together, grouped by the block whose clouds they need.

    Runs of keys alone are left out. If all runs are, the first one stays, since a solve tells which joints are seen.
    """
    runs = [slice(first, min(first + CHUNK_TOKENS, len(is_key))) for first in range(0, len(is_key), CHUNK_TOKENS)]
    runs = [run for run in runs if not is_key[run].all()] or runs[:1]
    return [list(block) for _, block in groupby(runs, lambda run: run.start // BLOCK_TOKENS)]


def _targets_of(scene: Scene, clouds: Clouds, first: int, last: int) -> Callable[[slice], Tensor]:
    """A function that gives the targets (n, P, 3) of the bound points in some of the tokens `first` to `last`."""
    tokens, binding = scene.tokens, clouds.binding
    # With the keys on both sides, at which the difference of the clouds is subtracted.
    low, high = widened_to_keys(np.flatnonzero(tokens.is_key), first, last)
    points, reference = clouds.at(low, high, tokens.around_gaps()[low:high])
    times, is_key = scene.times[low:high], scene.is_key[low:high]

    def differences(rows: Tensor | slice) -> tuple[Tensor, Tensor, Tensor]:
        """Bound points, the bones' frames that carry them, and the difference seen from these frames."""
        heads, rotations = base.rows(rows).world()
        frames = matrices(rotations)[:, binding.joints]
        bound = heads[:, binding.joints] + (frames @ binding.in_bone.unsqueeze(-1)).squeeze(-1)
        away = points[rows] - (bound if reference is None else reference[rows])
        return bound, frames, (frames.transpose(-1, -2) @ away.unsqueeze(-1)).squeeze(-1)

    base = scene.base.rows(slice(low, high))
    at_keys = torch.cat([differences(rows)[2] for rows in torch.nonzero(is_key).squeeze(-1).split(CHUNK_TOKENS)])

    def targets(rows: slice) -> Tensor:
        rows = slice(rows.start - low, rows.stop - low)
        bound, frames, away = differences(rows)
        away = away - interpolate_values(at_keys, times[is_key], times[rows])
        away = torch.where(is_key[rows, None, None], 0.0, away)  # also of keys whose clouds were not needed
        return bound + (frames @ away.unsqueeze(-1)).squeeze(-1)

    return targets


def apply_corrections(
    start: Start, corrections: Corrections, known: np.ndarray, options: FillOptions, confidence: Confidence | None
) -> Solved:
    """All frames of the clip, those of the gaps corrected as far as the corrections are believed."""
    scene, gaps = start.scene, np.flatnonzero(~known)
    applied = _smoothed(scene, _believed(scene, corrections, options, confidence), corrections.seen, options)
    values = torch.cat([applied.turns.flatten(1), applied.shifts], -1)
    at_frames = values.new_empty(len(start.gap_times), values.shape[1])
    for some in blocks_of(values.shape[1], _CURVES_AT_ONCE):
        at_frames[:, some] = interpolate_values(values[:, some], scene.times, start.gap_times, smooth=1.0)  # no kinks
    turns, shifts = at_frames[:, :-3].unflatten(-1, (-1, 3)), at_frames[:, -3:]
    if start.parts is not None:
        turns, shifts = start.parts.without(turns, shifts, scene.tokens.fps)
    pose = start.given.with_rows(gaps, start.base.corrected(turns, shifts))
    plain = np.zeros(pose.held.shape[:2], bool)
    plain[gaps] = applied.fallen[scene.tokens.nearest(gaps)]
    return Solved(pose, plain)


def _believed(scene: Scene, solved: Corrections, options: FillOptions, confidence: Confidence | None) -> _Applied:
    """Corrections as far as they are trusted, or shrunk by how far they stand out, gap by gap; none in gaps whose
    points could not be followed."""
    turns, shifts = torch.zeros_like(solved.turns), torch.zeros_like(solved.shifts)
    fallen = np.repeat(~solved.seen.cpu().numpy()[None], len(turns), axis=0)
    broken = ~torch.isfinite(solved.turns.flatten(1).sum(-1) + solved.shifts.sum(-1) + solved.residual)
    residual = torch.where(broken, torch.inf, solved.residual)
    for gap in scene.tokens.gaps():
        if float(residual[gap].mean()) > options.give_up_m:
            fallen[gap] = True
            continue
        if confidence is None:
            shares, shift_shares = believed_shares(solved, gap, options)
        else:
            shares, shift_shares = trust_of(confidence, scene.tokens, gap, scene.skeleton, solved)
            shift_shares = shift_shares.unsqueeze(-1)
        turns[gap] = solved.turns[gap] * shares.unsqueeze(-1)
        shifts[gap] = solved.shifts[gap] * shift_shares
        fallen[gap] |= (shares == 0).cpu().numpy()
    return _Applied(turns, shifts, fallen)


def believed_shares(solved: Corrections, gap: np.ndarray, options: FillOptions) -> tuple[Tensor, Tensor]:
    """What the fixed floors leave of a gap's corrections: of turns (J,), of the shift ()."""
    turns, shifts = solved.turns[gap], solved.shifts[gap]
    return _shares(turns, options.turn_floor_rad), _shares(shifts, options.shift_floor_m)


def _shares(corrections: Tensor, floor: float) -> Tensor:
    """(...) what to keep of a gap's corrections (n, ..., 3): 1 - floor^2 / their mean square, at least 0."""
    power = corrections.square().sum(-1).mean(0)
    return (1 - floor**2 / power.clamp(min=1e-20)).clamp(min=0)


def _smoothed(scene: Scene, believed: _Applied, seen: Tensor, options: FillOptions) -> _Applied:
    """Corrections as they are applied: zero at keys, and such that base and corrections together are smooth in time;
    also where they fell back, since the base alone bends at the keys. `seen` (J,): joints that some point sees."""
    base, tokens = scene.base, scene.tokens

    def smoothed(corrections: Tensor, bends: Callable[[], np.ndarray]) -> Tensor:
        """(N, F) of corrections whose base bends so, (N, F)."""
        values = np.where(tokens.is_key[:, None], 0.0, corrections.double().cpu().numpy())
        if options.smooth_span > 0:
            values = smooth_corrections(values, bends(), tokens.times, tokens.is_key, options.smooth_span)
        return torch.as_tensor(values * options.trust, dtype=torch.float32, device=scene.device)

    turns = torch.zeros_like(believed.turns)
    for joints in torch.nonzero(seen).squeeze(1).split(_CURVES_AT_ONCE // 3):
        own = smoothed(
            believed.turns[:, joints].flatten(1),
            lambda joints=joints: bends_of_rotations(base.local[:, joints], tokens.times).reshape(len(turns), -1),
        )
        turns[:, joints] = own.unflatten(-1, (-1, 3))
    pelvis = base.heads[:, scene.skeleton.root]
    shifts = smoothed(believed.shifts, lambda: bends_of_positions(pelvis.double().cpu().numpy(), tokens.times))
    return _Applied(turns, shifts, believed.fallen)
