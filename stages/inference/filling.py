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
from typing import Literal, NamedTuple, Protocol

import numpy as np
import roma
import torch
from torch import Tensor

from data_schemas.errors import InputError, UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.inference.binding import Binding, bind_points
from stages.inference.local_pose import LocalPose, correct_pose, pose_of_motion, replace_rows, rows_of_motion
from stages.inference.smoothing import bends_of_positions, bends_of_rotations, smooth_corrections
from stages.inference.solving import Corrections, SolveOptions, solve_pose
from stages.inference.token_times import Tokens, choose_tokens
from stages.kinematics.conventions import MODEL_FPS
from stages.kinematics.plain_interpolation import interpolate_values
from stages.pointcloud.sampling import draw_points, place_points, points_in_bone

Cloud = Literal["synthesised", "reconstructed", "true"]
CHUNK_TOKENS = 1024  # bounds the memory of a long clip


class CloudAutoencoder(Protocol):
    """What filling needs of an autoencoder. Times are real-valued model frames; points are metres in the world."""

    def encode(self, points: Tensor, groups: Tensor) -> tuple[Tensor, Tensor]:
        """(T, P, 3) and (P,) to latents (T, D) and centroids (T, 3)."""
        ...

    def decode(self, latents: Tensor, centroids: Tensor, times: Tensor, groups: Tensor, noise: Tensor) -> Tensor:
        """(T, D), (T, 3), (T,), (P,), (P, Z) to points (T, P, 3)."""
        ...

    def draw_noise(self, points: int, seed: int) -> Tensor:
        """Identities (P, Z) of points."""
        ...


class CloudModels(Protocol):
    """What filling needs of trained models."""

    @property
    def autoencoder(self) -> CloudAutoencoder: ...

    def synthesise(
        self, latents: Tensor, centroids: Tensor, known: Tensor, times: Tensor, base: tuple[Tensor, Tensor] | None
    ) -> tuple[Tensor, Tensor]:
        """Latents, centroids (read where known), (T,) True for keys, and those of the plain interpolation."""
        ...


@dataclass(frozen=True)
class FillOptions:
    """Numbers to tune on validation data.

    solve:       strength of the solve's prior.
    base_smooth: 0 starts from slerp, 1 from the cubic through the keys.
    smooth_span: corrections are smoothed in time over about this many model frames (0: not at all).
    trust:       corrections are multiplied by this; 0 gives the base.
    give_up_m:   a gap whose points are left this far from their targets, on average, falls back to the base.
    sigma_m:     spread of the cloud around the bones.
    """

    solve: SolveOptions = field(default_factory=SolveOptions)
    base_smooth: float = 0.0
    smooth_span: float = 0.0
    trust: float = 1.0
    give_up_m: float = 0.25
    sigma_m: float = 0.05


@dataclass(frozen=True)
class Filled:
    """A filled motion and what a summary should say of it.

    motion:         as many frames as were given, at the same rate; keys are the given rows, value for value.
    plain:          (T, J) bool, True where a frame that is no key has the plain interpolation's local rotation.
    jump_frames:    (K,) keys that border a gap and have frames on both sides.
    jumps_mps:      (K,) mean change of the body joints' velocity at these keys, metres a second.
    base_jumps_mps: (K,) the same of the plain interpolation.
    longest_gap_s:  longest time between two neighbouring keys, or between a key and an end of the clip.
    """

    motion: Motion
    plain: np.ndarray
    jump_frames: np.ndarray
    jumps_mps: np.ndarray
    base_jumps_mps: np.ndarray
    longest_gap_s: float


class _Drawn(NamedTuple):
    """Points drawn on a skeleton. Only `groups` goes to the models and the solve, never `bones`."""

    bones: Tensor  # (P,)
    in_bone: Tensor  # (P, 3)
    groups: Tensor  # (P,)


class _Clouds(NamedTuple):
    """Where points are and where the same points are on the base: (N, P, 3) each, and how they ride on the bones."""

    points: Tensor
    reference: Tensor | None  # None: the bound points themselves
    binding: Binding


def fill_motion(
    skeleton: Skeleton,
    motion: Motion,
    known: np.ndarray,
    models: CloudModels | None,
    *,
    cloud: Cloud = "synthesised",
    points: int = 256,
    seed: int = 0,
    device: torch.device | str = "cpu",
    options: FillOptions | None = None,
) -> Filled:
    """Fill the frames of a motion that are not known.

    Args:
        motion: T frames; with `cloud="synthesised"` only the known ones are read.
        known: (T,) bool, True where the frame is given.
        models: trained models; None will do for `cloud="true"`.
        cloud: "synthesised" is the real thing. For measuring its parts: "true" solves on points of the true motion,
            "reconstructed" on the true motion's points encoded and decoded; both see positions and groups alone.
        points: size of the cloud.
        seed: of the points' places and identities; the same seed gives the same motion.

    Raises: UsageError where models are missing; InputError where no frame is known or no bone can be seen.
    """
    options = options or FillOptions()
    keys = np.flatnonzero(known)
    _check(skeleton, motion, known, models, cloud)
    key_pose = pose_of_motion(skeleton, rows_of_motion(motion, keys), device)
    tokens = choose_tokens(keys, motion.frames, motion.fps)
    gaps = np.flatnonzero(~np.asarray(known, bool))
    key_times = torch.as_tensor(keys * (MODEL_FPS / motion.fps), device=device)
    gap_times = torch.as_tensor(gaps * (MODEL_FPS / motion.fps), device=device)
    if len(gaps) == 0:
        return _nothing_to_fill(skeleton, motion)
    base = key_pose.at(key_times, torch.as_tensor(tokens.times, device=device), options.base_smooth)
    with torch.no_grad():
        clouds = _make_clouds(skeleton, motion, base, tokens, models, cloud, points, seed, options)
        solved = _solve_tokens(skeleton, base, tokens, clouds, options)
    fallen = _fallen_back(solved, tokens, options)
    turns, shifts = _smoothed(skeleton, base, solved, tokens, fallen, options)
    at_frames = interpolate_values(
        torch.cat([turns.flatten(1), shifts], -1), torch.as_tensor(tokens.times, device=device), gap_times, smooth=1.0
    )
    frame_base = key_pose.at(key_times, gap_times, options.base_smooth)
    frame_turns = at_frames[:, :-3].unflatten(-1, (-1, 3))
    pose = correct_pose(frame_base, frame_turns, at_frames[:, -3:], skeleton, motion.track_joints)
    filled = replace_rows(skeleton, motion, motion.frames, pose, gaps)
    plain = np.zeros(filled.rotations.shape[:2], bool)
    plain[gaps] = ~solved.seen.cpu().numpy() | fallen[tokens.nearest(gaps)][:, None]
    plain_motion = replace_rows(skeleton, motion, motion.frames, frame_base, gaps)
    jump_frames = _keys_at_gaps(known)
    return Filled(
        filled,
        plain,
        jump_frames,
        velocity_jumps(skeleton, filled, jump_frames),
        velocity_jumps(skeleton, plain_motion, jump_frames),
        float(np.diff(np.concatenate([[0], keys, [motion.frames - 1]])).max() / motion.fps),
    )


def velocity_jumps(skeleton: Skeleton, motion: Motion, frames: np.ndarray) -> np.ndarray:
    """(K,) mean over the body's joints of |velocity after - before| at inner frames (K,), metres a second."""
    rows = rows_of_motion(motion, (frames[:, None] + np.array([-1, 0, 1])).ravel())
    heads, _ = pose_of_motion(skeleton, rows).world(skeleton.parents)
    heads = heads[:, torch.as_tensor(skeleton.groups >= 0)].unflatten(0, (-1, 3))
    change = heads[:, 2] - 2 * heads[:, 1] + heads[:, 0]
    return (change.norm(dim=-1).mean(-1) * motion.fps).numpy()


def _check(skeleton: Skeleton, motion: Motion, known: np.ndarray, models: CloudModels | None, cloud: str) -> None:
    if np.shape(known) != (motion.frames,):
        raise UsageError(f"`known` has shape {np.shape(known)}, but the motion has {motion.frames} frames.")
    if not np.any(known):
        raise InputError("No frame of the motion is known, so there is nothing to fill from.", "Give a keyframe.")
    if cloud not in ("synthesised", "reconstructed", "true"):
        raise UsageError(f"The cloud {cloud!r} is none of synthesised, reconstructed and true.")
    if models is None and cloud != "true":
        raise UsageError(f"A {cloud} cloud needs trained models.", "Give weights.")
    if not np.any(skeleton.sampled):
        raise InputError("The skeleton has no bone that a point cloud can see.", "Look at it with pumps inspect.")


def _nothing_to_fill(skeleton: Skeleton, motion: Motion) -> Filled:
    none = np.zeros(0)
    plain = np.zeros(motion.rotations.shape[:2], bool)
    return Filled(motion, plain, none.astype(np.int64), none, none, 1 / motion.fps)


def _keys_at_gaps(known: np.ndarray) -> np.ndarray:
    known = np.asarray(known, bool)
    inner = known[1:-1] & ~(known[2:] & known[:-2])
    return np.flatnonzero(inner) + 1


def _draw(skeleton: Skeleton, points: int, seed: int, sigma_m: float, device: torch.device) -> _Drawn:
    lengths = np.linalg.norm(skeleton.tails, axis=-1) * skeleton.sampled
    drawn = draw_points(lengths, points, np.random.default_rng(seed))
    bones, alphas, offsets = (torch.as_tensor(part, device=device) for part in drawn)
    tails = torch.as_tensor(skeleton.tails, dtype=torch.float32, device=device)
    groups = torch.as_tensor(skeleton.groups, device=device).long()[bones.long()]
    return _Drawn(bones, points_in_bone(tails, bones, alphas, offsets, sigma_m), groups)


def _place(drawn: _Drawn, pose: LocalPose, skeleton: Skeleton) -> Tensor:
    """Drawn points (T, P, 3) on a pose, a chunk at a time."""
    parts = []
    for start in range(0, len(pose.roots), CHUNK_TOKENS):
        heads, rotations = pose.rows(slice(start, start + CHUNK_TOKENS)).world(skeleton.parents)
        parts.append(place_points(heads, rotations, drawn.bones, drawn.in_bone))
    return torch.cat(parts)


def _make_clouds(
    skeleton: Skeleton,
    motion: Motion,
    base: LocalPose,
    tokens: Tokens,
    models: CloudModels | None,
    cloud: Cloud,
    points: int,
    seed: int,
    options: FillOptions,
) -> _Clouds:
    device = base.roots.device
    drawn = _draw(skeleton, points, seed, options.sigma_m, device)
    times = torch.as_tensor(tokens.times, device=device)
    is_key = torch.as_tensor(tokens.is_key, device=device)
    true_points = drawn.in_bone  # replaced where the truth is looked at
    if cloud != "synthesised":
        frame_times = torch.arange(motion.frames, device=device) * (MODEL_FPS / motion.fps)
        truth = pose_of_motion(skeleton, motion, device).at(frame_times.double(), times)
        true_points = _place(drawn, truth, skeleton)
    if models is None or cloud == "true":
        heads, rotations = base.rows(is_key).world(skeleton.parents)
        return _Clouds(true_points, None, bind_points(true_points[is_key], drawn.groups, skeleton, heads, rotations))
    base_points = _place(drawn, base, skeleton)
    coder = models.autoencoder
    plain = coder.encode(base_points, drawn.groups)
    if cloud == "synthesised":
        better = models.synthesise(*plain, is_key, times, plain)
    else:
        better = coder.encode(true_points, drawn.groups)
    noise = coder.draw_noise(points, seed)
    reference = coder.decode(*plain, times, drawn.groups, noise).to(device)
    found = coder.decode(*better, times, drawn.groups, noise).to(device)
    shown = torch.as_tensor(tokens.spread(), device=device)
    heads, rotations = base.rows(shown).world(skeleton.parents)
    return _Clouds(found, reference, bind_points(reference[shown], drawn.groups, skeleton, heads, rotations))


def _solve_tokens(
    skeleton: Skeleton, base: LocalPose, tokens: Tokens, clouds: _Clouds, options: FillOptions
) -> Corrections:
    """Carry the base's bound points by the clouds' difference, less what the difference is at the keys, and solve."""
    binding, parents = clouds.binding, skeleton.parents
    device = base.roots.device
    times = torch.as_tensor(tokens.times, device=device)
    is_key = torch.as_tensor(tokens.is_key, device=device)

    def differences(rows: Tensor | slice) -> tuple[Tensor, Tensor, Tensor]:
        """Bound points, the bones' frames that carry them, and the difference seen from these frames."""
        heads, rotations = base.rows(rows).world(parents)
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
        part = base.rows(rows)
        parts.append(solve_pose(targets, binding, *part, parents, skeleton.root, options.solve))
    turns, shifts, _, residual = (torch.cat(values) for values in zip(*parts, strict=True))
    return Corrections(turns, shifts, parts[0].seen, residual)


def _fallen_back(solved: Corrections, tokens: Tokens, options: FillOptions) -> np.ndarray:
    """(N,) True for tokens of a gap in which the points could not be followed."""
    broken = ~torch.isfinite(solved.turns.flatten(1).sum(-1) + solved.shifts.sum(-1) + solved.residual)
    residual = torch.where(broken, torch.inf, solved.residual).cpu().numpy()
    fallen = np.zeros(len(residual), bool)
    for gap in tokens.gaps():
        fallen[gap] = residual[gap].mean() > options.give_up_m
    return fallen


def _smoothed(
    skeleton: Skeleton, base: LocalPose, solved: Corrections, tokens: Tokens, fallen: np.ndarray, options: FillOptions
) -> tuple[Tensor, Tensor]:
    """Corrections (N, J, 3) and (N, 3) as they are applied: zero at keys and in gaps that fell back."""
    still = tokens.is_key | fallen
    seen = solved.seen.cpu().numpy()
    turns = solved.turns.double().cpu().numpy()
    values = np.concatenate([turns[:, seen].reshape(len(turns), -1), solved.shifts.double().cpu().numpy()], -1)
    values = np.where(still[:, None], 0.0, values)
    if options.smooth_span > 0:
        turning = bends_of_rotations(base.local[:, solved.seen], tokens.times).reshape(len(turns), -1)
        moving = bends_of_positions(base.roots.double().cpu().numpy(), tokens.times)
        bends = np.concatenate([turning, moving], -1)
        values = smooth_corrections(values, bends, tokens.times, still, options.smooth_span)
    smooth = torch.as_tensor(values * options.trust, dtype=torch.float32, device=base.roots.device)
    out = torch.zeros_like(solved.turns)
    out[:, solved.seen] = smooth[:, :-3].unflatten(-1, (-1, 3))
    return out, smooth[:, -3:]
