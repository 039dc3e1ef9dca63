"""Fill a motion between its keys: cloud of the plain interpolation, its difference to a better cloud, and the solve.

    base    the plain interpolation of the keys, at 30 frames a second and at the keys' exact times
    cloud   points riding on the base; encoded, synthesised and decoded, they move where the models think they should
    solve   the decoded *difference* carries the base's points, and the joints follow the points
    output  the corrections, zero at every key, brought to the clip's own frames

Only the difference between two decodings counts, and what is left of it at the keys is taken off: whatever the
networks get wrong in the same way for both costs nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import roma
import torch
from torch import Tensor

from data_schemas.errors import InputError, UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.inference.clouds import (
    CHUNK_TOKENS,
    CloudModels,
    Clouds,
    CloudSource,
    Scene,
    draw_on_skeleton,
    find_clouds,
    spread_on_skeleton,
)
from stages.shared.inference.confidence import Confidence, trust_of
from stages.shared.inference.easing import ease_at_keys
from stages.shared.inference.filled import Filled, keys_at_gaps, nothing_to_fill, skates, velocity_jumps
from stages.shared.inference.foot_lock import lock_feet
from stages.shared.inference.token_times import choose_tokens
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.foot_contacts import has_feet
from stages.shared.kinematics.plain_interpolation import Glide, Smoothness, damped_smoothness, interpolate_values
from stages.shared.solve.key_prior import turn_prior
from stages.shared.solve.local_pose import LocalPose, correct_pose, pose_of_motion, replace_rows
from stages.shared.solve.smoothing import bends_of_positions, bends_of_rotations, smooth_corrections
from stages.shared.solve.solving import Corrections, SolveOptions, solve_pose


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
    views:       how often the networks see the clip, turned and mirrored (`find_clouds`), each with points spread
                 over the bones anew, as many as the encoder was trained on.
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


class Solved(NamedTuple):
    """A clip's tokens, the clouds of them, and the corrections that these ask for, neither shrunk nor smoothed."""

    scene: Scene
    clouds: Clouds
    corrections: Corrections
    key_pose: LocalPose


class _Applied(NamedTuple):
    """Corrections as applied at the tokens: turns (N, J, 3) radians, shifts (N, 3) metres, (N, J) True: fell back."""

    turns: Tensor
    shifts: Tensor
    fallen: np.ndarray


def fill_motion(
    skeleton: Skeleton,
    motion: Motion,
    known: np.ndarray,
    models: CloudModels | None,
    *,
    cloud: CloudSource = "synthesised",
    points: int = 256,
    seed: int = 0,
    device: torch.device | str = "cpu",
    options: FillOptions | None = None,
    latents: tuple[Tensor, Tensor] | None = None,
) -> Filled:
    """Fill the frames of a motion that are not known.

    Args:
        motion: T frames; with `cloud` "synthesised" or "latents" only the known ones are read.
        known: (T,) bool, True where the frame is given.
        models: trained models; None will do for `cloud="true"`.
        cloud: "synthesised" is the real thing. For measuring its parts: "true" solves on points of the true motion,
            "reconstructed" on the true motion's points encoded and decoded; both see positions and groups alone.
            "latents" decodes the `latents` given.
        points: size of the cloud.
        seed: of the points' places and identities; the same seed gives the same motion.
        options: None takes the defaults for decoded clouds, or `TRUE_CLOUD` where the cloud is the true one.
        latents: for `cloud="latents"`, (T, D) and centroids (T, 3) metres, one for each frame of a motion at 30 fps.

    Raises: UsageError where arguments do not belong together; InputError where no frame is known or no bone is seen.
    """
    options = options or (TRUE_CLOUD if cloud == "true" else FillOptions())
    _check(skeleton, motion, known, models, cloud, latents)
    known = np.asarray(known, bool)
    keys, gaps = np.flatnonzero(known), np.flatnonzero(~known)
    if len(gaps) == 0:
        return nothing_to_fill(motion)
    solved = solve_clip(
        skeleton, motion, known, models, cloud=cloud, points=points, seed=seed, device=device, options=options,
        latents=latents,
    )  # fmt: skip
    scene, clouds, key_pose = solved.scene, solved.clouds, solved.key_pose
    tokens = scene.tokens
    confidence = getattr(models, "confidence", None) if cloud == "synthesised" else None
    key_times, gap_times = (torch.as_tensor(f * (MODEL_FPS / motion.fps), device=device) for f in (keys, gaps))
    smooth, glide = _base_settings(key_times, models, options)
    with torch.no_grad():
        applied = _smoothed(scene, solved.corrections, options, confidence)
        frame_base = key_pose.at(key_times, gap_times, smooth, glide)
        pose = _corrected(scene, applied, frame_base, gap_times)
    loose = _eased(skeleton, replace_rows(skeleton, motion, pose, gaps), known, options.ease_s)
    filled = lock_feet(skeleton, loose, known).motion if options.foot_lock and has_feet(skeleton) else loose
    plain = np.zeros(filled.rotations.shape[:2], bool)
    plain[gaps] = applied.fallen[tokens.nearest(gaps)]
    base_filled = replace_rows(skeleton, motion, frame_base, gaps)
    skate, base_skate, loose_skate = skates(skeleton, loose, known, filled, base_filled, loose)
    jump_frames = keys_at_gaps(known)
    return Filled(
        filled,
        plain,
        jump_frames,
        velocity_jumps(skeleton, filled, jump_frames),
        velocity_jumps(skeleton, base_filled, jump_frames),
        skate,
        base_skate,
        loose_skate,
        float(np.diff(np.concatenate([[0], keys, [motion.frames - 1]])).max() / motion.fps),
        float(clouds.binding.wander.nanmedian()),
    )


def solve_clip(
    skeleton: Skeleton,
    motion: Motion,
    known: np.ndarray,
    models: CloudModels | None,
    *,
    cloud: CloudSource = "synthesised",
    points: int = 256,
    seed: int = 0,
    device: torch.device | str = "cpu",
    options: FillOptions | None = None,
    latents: tuple[Tensor, Tensor] | None = None,
) -> Solved:
    """What `fill_motion` knows before it decides how much to believe of it; arguments as there, a frame missing."""
    options = options or FillOptions()
    keys = np.flatnonzero(known)
    key_pose = pose_of_motion(skeleton, motion.at(keys), device)
    key_times = torch.as_tensor(keys * (MODEL_FPS / motion.fps), device=device)
    tokens = choose_tokens(keys, motion.frames, motion.fps)
    smooth, glide = _base_settings(key_times, models, options)
    base = key_pose.at(key_times, torch.as_tensor(tokens.times, device=device), smooth, glide)
    scene = Scene(skeleton, motion, tokens, base)
    with torch.no_grad():
        rng = np.random.default_rng(seed)
        drawn = draw_on_skeleton(skeleton, points, rng, options.sigma_m, device)
        count, size = (0, 0) if models is None else (max(options.views, 1), models.autoencoder.points)
        starts = (np.arange(count) + 0.5) / max(count, 1)
        encoded = [spread_on_skeleton(skeleton, size, start, options.sigma_m, device) for start in starts]
        clouds = find_clouds(scene, drawn, encoded, models, cloud, seed, latents)
        # What a joint did not do over the keys, noise in the points does not make it do between them.
        prior = turn_prior(key_pose.local, options.solve.turn_prior_rad)
        return Solved(scene, clouds, _solve_tokens(scene, clouds, options.solve, prior), key_pose)


def _base_settings(
    key_times: Tensor, models: CloudModels | None, options: FillOptions
) -> tuple[Smoothness, Glide | None]:
    """How the plain interpolation runs between the keys and beyond them."""
    smooth = damped_smoothness(key_times, MODEL_FPS) if options.base_smooth is None else options.base_smooth
    return smooth, None if models is None else models.glide.in_frames(MODEL_FPS)


def _eased(skeleton: Skeleton, filled: Motion, known: np.ndarray, span_s: float) -> Motion:
    """The filled motion without kinks at its keys."""
    if span_s <= 0:
        return filled
    gaps = np.flatnonzero(~known)
    pose = ease_at_keys(pose_of_motion(skeleton, filled), known, filled.fps, span_s)
    return replace_rows(skeleton, filled, pose.rows(torch.as_tensor(gaps)), gaps)


def _check(
    skeleton: Skeleton,
    motion: Motion,
    known: np.ndarray,
    models: CloudModels | None,
    cloud: str,
    latents: tuple[Tensor, Tensor] | None,
) -> None:
    if np.shape(known) != (motion.frames,):
        raise UsageError(f"`known` has shape {np.shape(known)}, but the motion has {motion.frames} frames.")
    if not np.any(known):
        raise InputError("No frame of the motion is known, so there is nothing to fill from.", "Give a keyframe.")
    if cloud not in ("synthesised", "reconstructed", "true", "latents"):
        raise UsageError(f"The cloud {cloud!r} is none of synthesised, reconstructed, true and latents.")
    if models is None and cloud != "true":
        raise UsageError(f"A {cloud} cloud needs trained models.", "Give weights.")
    if (cloud == "latents") != (latents is not None):
        raise UsageError("Latents are given with the cloud 'latents', and only with it.")
    if latents is not None and (motion.fps != MODEL_FPS or len(latents[0]) != motion.frames):
        raise UsageError(
            f"{len(latents[0])} latents do not fit a motion of {motion.frames} frames at {motion.fps:g} fps.",
            f"Give one latent for each frame of a motion at {MODEL_FPS:g} fps.",
        )
    if not np.any(skeleton.sampled):
        raise InputError("The skeleton has no bone that a point cloud can see.", "Look at it with pumps inspect.")


def _solve_tokens(scene: Scene, clouds: Clouds, options: SolveOptions, prior: Tensor) -> Corrections:
    """Carry the base's bound points by the clouds' difference, less what the difference is at the keys, and solve;
    `prior` (J, 3, 3) is the joints' (`turn_prior`)."""
    binding, parents = clouds.binding, scene.skeleton.parents
    times, is_key = scene.times, scene.is_key

    def differences(rows: Tensor | slice) -> tuple[Tensor, Tensor, Tensor]:
        """Bound points, the bones' frames that carry them, and the difference seen from these frames."""
        heads, rotations = scene.base_world(rows)
        frames = roma.unitquat_to_rotmat(rotations)[:, binding.joints]
        bound = heads[:, binding.joints] + (frames @ binding.in_bone.unsqueeze(-1)).squeeze(-1)
        away = clouds.points[rows] - (bound if clouds.reference is None else clouds.reference[rows])
        return bound, frames, (frames.transpose(-1, -2) @ away.unsqueeze(-1)).squeeze(-1)

    at_keys = torch.cat([differences(rows)[2] for rows in torch.nonzero(is_key).squeeze(-1).split(CHUNK_TOKENS)])
    parts: list[Corrections] = []
    for start in range(0, len(times), CHUNK_TOKENS):
        rows = slice(start, start + CHUNK_TOKENS)
        bound, frames, away = differences(rows)
        away = away - interpolate_values(at_keys, times[is_key], times[rows])
        targets = bound + (frames @ away.unsqueeze(-1)).squeeze(-1)
        base = scene.base.rows(rows)
        parts.append(solve_pose(targets, binding, *base, parents, scene.skeleton.root, options, prior))
    turns, shifts, _, residual = (torch.cat(values) for values in zip(*parts, strict=True))
    return Corrections(turns, shifts, parts[0].seen, residual)


def _believed(
    scene: Scene, solved: Corrections, options: FillOptions, confidence: Confidence | None = None
) -> _Applied:
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


def _smoothed(scene: Scene, solved: Corrections, options: FillOptions, confidence: Confidence | None) -> _Applied:
    """Corrections as they are applied: shrunk, zero at keys, and such that base and corrections together are smooth
    in time; also where they fell back, since the base alone bends at the keys."""
    base, tokens = scene.base, scene.tokens
    believed = _believed(scene, solved, options, confidence)
    values = torch.cat([believed.turns[:, solved.seen].flatten(1), believed.shifts], -1).double().cpu().numpy()
    values = np.where(tokens.is_key[:, None], 0.0, values)
    if options.smooth_span > 0:
        turning = bends_of_rotations(base.local[:, solved.seen], tokens.times).reshape(len(values), -1)
        pelvis = base.world(scene.skeleton.parents)[0][:, scene.skeleton.root]
        moving = bends_of_positions(pelvis.double().cpu().numpy(), tokens.times)
        bends = np.concatenate([turning, moving], -1)
        values = smooth_corrections(values, bends, tokens.times, tokens.is_key, options.smooth_span)
    smooth = torch.as_tensor(values * options.trust, dtype=torch.float32, device=scene.device)
    out = torch.zeros_like(solved.turns)
    out[:, solved.seen] = smooth[:, :-3].unflatten(-1, (-1, 3))
    return _Applied(out, smooth[:, -3:], believed.fallen)


def _corrected(scene: Scene, applied: _Applied, frame_base: LocalPose, frame_times: Tensor) -> LocalPose:
    """The base at the clip's own missing frames with the tokens' corrections, carried there without kinks."""
    values = torch.cat([applied.turns.flatten(1), applied.shifts], -1)
    at_frames = interpolate_values(values, scene.times, frame_times, smooth=1.0)
    turns = at_frames[:, :-3].unflatten(-1, (-1, 3))
    return correct_pose(frame_base, turns, at_frames[:, -3:], scene.skeleton, scene.motion.track_joints)
