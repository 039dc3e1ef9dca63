"""Fits any skeleton to any cloud: from a moving cloud and a few known poses of the skeleton to the whole motion.

    fit      the cloud's scale and position relative to the skeleton's, at the keys (for clouds of another body)
    bind     the bone of every point, from positions and body groups at the keys
    solve    every frame's pose, starting from the keys' plain interpolation
    smooth   by a strength that is estimated from the corrections themselves
    keys     corrections that remain at the keys are spread over the gaps and subtracted

Nothing is trained. The cloud may be true, decoded or noisy, of this body or of a larger one, and some body groups may
be missing.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import torch
from torch import Tensor

from data_schemas.errors import UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.kinematics.forward import global_rotations, local_rotations
from stages.shared.kinematics.plain_interpolation import damped_smoothness, interpolate_values
from stages.shared.kinematics.rotations import from_turn_vectors, multiply, turns_between
from stages.shared.solve.binding import Binding, bind_points
from stages.shared.solve.key_prior import turn_prior
from stages.shared.solve.scaling import fit_cloud
from stages.shared.solve.skeleton_pose import SkeletonPose, pose_of_motion, replace_rows
from stages.shared.solve.smoothing import smooth_as_needed
from stages.shared.solve.solving import Corrections, SolveOptions, solve_pose

HUBER_NOISES = 3.5  # a point whose distance is more than this multiple of its noise on each axis is an outlier
LEAST_KEYS_FOR_NOISE = 3
LEAST_FRAMES_TO_SMOOTH = 8
JITTER_M = 0.004  # points that fit better than this cause no jitter in the motion
STILL_M = 0.01  # points that move less than this on their bones count as still


@dataclass(frozen=True)
class FollowOptions:
    """Options for following a cloud.

    solve:  strength of the solve's prior; its `point_noise_m` is the least noise that is assumed.
    scale:  the cloud's lengths over the skeleton's; None finds it from the keys; 1 also uses the cloud's position in
            the world for the skeleton.
    smooth: False leaves every frame as solved.
    """

    solve: SolveOptions = field(default_factory=lambda: SolveOptions(point_noise_m=0.01, rigid_start=True))
    scale: float | None = 1.0
    smooth: bool = True


@dataclass(frozen=True)
class Followed:
    """A motion that follows a cloud.

    motion:     T frames; the keys are the given rows, value for value.
    seen:       (J,) bool, joints with points; all others keep the keys' plain interpolation.
    scale:      the cloud's lengths over the skeleton's.
    noise_m:    how far points move on their bones along each axis, metres, from the keys; NaN if there are too few
                keys.
    residual_m: (T,) root mean square distance that remains between points and bones, metres, in the skeleton's size.
    """

    motion: Motion
    seen: np.ndarray
    scale: float
    noise_m: float
    residual_m: np.ndarray


def follow_cloud(
    skeleton: Skeleton,
    motion: Motion,
    known: np.ndarray,
    points: Tensor,
    groups: Tensor,
    options: FollowOptions | None = None,
) -> Followed:
    """The motion of a cloud, on a skeleton whose pose is known in some frames.

    Args:
        motion: T frames, of which only the known ones are read.
        known: (T,) bool, at least one True.
        points: (T, P, 3) the cloud at the motion's frames, metres; on the device to compute on.
        groups: (P,) body group of each point.

    Raises: UsageError if shapes disagree; InputError if no bone has points.
    """
    options = options or FollowOptions()
    known = np.asarray(known, bool)
    if known.shape != (motion.frames,) or len(points) != motion.frames or not known.any():
        raise UsageError(
            f"{len(points)} clouds, {motion.frames} frames and {int(known.sum())} keys do not go together."
        )
    device = points.device
    keys = np.flatnonzero(known)
    key_pose = pose_of_motion(skeleton, motion.at(keys), device)
    times = torch.arange(motion.frames, dtype=torch.float64, device=device)
    at_keys = torch.as_tensor(keys, device=device)
    key_times = times[at_keys]
    heads, rotations = key_pose.world()
    scale = 1.0
    if options.scale != 1.0:
        fit = fit_cloud(points[at_keys], groups, skeleton, heads, rotations, scale=options.scale)
        points, scale = fit.to_skeleton(points, times, key_times), fit.scale
    binding, noise = _bound(points[at_keys], groups, skeleton, heads, rotations)
    base = key_pose.at(key_times, times, damped_smoothness(key_times, motion.fps) if len(keys) > 1 else 0.0)
    solve = _fitted_to(options.solve, noise)
    found = solve_pose(
        points, binding, *base.parts, skeleton.parents, skeleton.root, solve,
        turn_prior(key_pose.local, solve.turn_prior_rad),
    )  # fmt: skip
    jitters = float(found.residual.median()) > JITTER_M
    turns, shifts = _finished(found, base, keys, times, options.smooth and jitters)
    pose = base.corrected(turns, shifts)
    gaps = np.flatnonzero(~known)
    out = (
        replace_rows(skeleton, motion, pose.rows(torch.as_tensor(gaps, device=device)), gaps) if len(gaps) else motion
    )
    return Followed(out, found.seen.cpu().numpy(), scale, noise, found.residual.cpu().numpy())


def _bound(
    points: Tensor, groups: Tensor, skeleton: Skeleton, heads: Tensor, rotations: Tensor
) -> tuple[Binding, float]:
    """Points (K, P, 3) tied to bones, and their noise along each axis: if all points are noisy, a point that moves in
    its bone's frame is not an outlier.
    """
    binding = bind_points(points, groups, skeleton, heads, rotations)
    if len(points) < LEAST_KEYS_FOR_NOISE:
        return binding, float("nan")
    wander = float(binding.wander.nanmedian())
    if wander > STILL_M:
        binding = bind_points(points, groups, skeleton, heads, rotations, still_m=wander)
    return binding, wander * (len(points) / (len(points) - 1) / 3) ** 0.5


def _fitted_to(options: SolveOptions, noise_m: float) -> SolveOptions:
    """The solve's options for points of this noise."""
    noise = max(options.point_noise_m, 0.0 if np.isnan(noise_m) else noise_m)
    return replace(options, point_noise_m=noise, huber_m=max(options.huber_m, HUBER_NOISES * noise))


def _finished(
    found: Corrections, base: SkeletonPose, keys: np.ndarray, times: Tensor, smooth: bool
) -> tuple[Tensor, Tensor]:
    """Corrections smooth in time and zero at the keys, as `solve_pose` gives them.

    Rotations are smoothed in the world. A joint's rotation compensates for errors of its parents' rotations, so
    smoothing one without the other would move all joints below.
    """
    skeleton, seen = base.skeleton, found.seen
    parents = skeleton.parents
    heads, plain = base.world()
    solved = global_rotations(multiply(base.local, from_turn_vectors(found.turns)), parents)
    shifts = found.shifts
    if smooth and len(solved) >= LEAST_FRAMES_TO_SMOOTH:
        solved[:, seen] = _smooth_rotations(solved[:, seen])
        pelvis = heads[:, skeleton.root]
        shifts = _smooth(pelvis + shifts) - pelvis
    # Corrections that remain at the keys are subtracted, also in the gaps between them, along a curve without kinks.
    left = torch.zeros_like(found.turns[keys])
    left[:, seen] = turns_between(plain[keys], solved[keys])[:, seen]
    turns = interpolate_values(left, times[keys], times, smooth=1.0)
    shifts = shifts - interpolate_values(shifts[keys], times[keys], times, smooth=1.0)
    local = local_rotations(multiply(solved, from_turn_vectors(-turns)), parents)
    own = turns_between(base.local, local)
    return own * seen.unsqueeze(-1), shifts


def _smooth_rotations(rotations: Tensor) -> Tensor:
    """Rotations (T, S, 4) smoothed along the path of their steps, in their own axes."""
    steps = turns_between(rotations[:-1], rotations[1:])
    path = torch.cat([torch.zeros_like(steps[:1]), steps.cumsum(0)])
    return multiply(rotations, from_turn_vectors(_smooth(path) - path))


def _smooth(curves: Tensor) -> Tensor:
    flat = smooth_as_needed(curves.flatten(1).double().cpu().numpy())
    return torch.as_tensor(flat, dtype=curves.dtype, device=curves.device).view_as(curves)
