"""Clean a motion of any rig by latents, without training on the rig.

    latents of the motion -> corrected latents -> difference of the decoded clouds -> solve, the motion as its prior

The motion's cloud is encoded, a denoiser (`pumps train denoiser`) corrects the latents, and both are decoded with the
same point identities. As in filling, only the difference of the two decodings moves points, so constant errors of the
autoencoder cancel.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from scipy.ndimage import uniform_filter1d
from torch import Tensor

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.inference.cloud_interfaces import Clouds, CloudSource, Drawing, Pair, Scene
from stages.shared.inference.clouds import CHUNK_TOKENS, place_on_pose
from stages.shared.inference.decoded_clouds import corrected_in_windows, decoded_clouds, drawn_views, followed_points
from stages.shared.inference.latent_denoiser import LatentDenoiser
from stages.shared.inference.models import Span
from stages.shared.inference.token_times import Tokens
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.plain_interpolation import interpolate_values
from stages.shared.solve.binding import Binding, carry_points
from stages.shared.solve.skeleton_pose import SkeletonPose
from stages.shared.solve.solving import Corrections, SolveOptions, solve_pose

_FAST = 1.2  # times 30 frames a second: a mended motion that is faster gets corrections at 30, interpolated


@dataclass(frozen=True)
class LatentOptions:
    """Numbers to tune on validation data.

    solve:   weights of the points against the motion.
    sigma_m: spread of the points around the bones, metres. points: of the cloud that the solve follows.
    views:   how often the networks see the clip, turned and mirrored.
    turn_floor_rad, shift_floor_m: corrections whose root mean square over `floor_frames` frames is below these are
             left out; larger ones lose as much power (James and Stein), so that what is clean stays.
    """

    solve: SolveOptions = field(default_factory=SolveOptions)
    sigma_m: float = 0.05
    points: int = 256
    views: int = 4
    turn_floor_rad: float = 0.03
    shift_floor_m: float = 0.004
    floor_frames: int = 15
    seed: int = 0


def denoised_by_latents(
    denoiser: LatentDenoiser, skeleton: Skeleton, noisy: Motion, mended: Motion, options: LatentOptions | None = None
) -> Motion:
    """The motion with the denoiser's corrections, at its own rate, in time linear in its length.

    Args:
        noisy: T frames as they were given. mended: the same after `mend_poses`. The denoiser corrects the one on
            whose latents it was trained.
    """
    options = options or LatentOptions()
    motion = mended if denoiser.start == "mended" else noisy
    pose = SkeletonPose.of_motion(skeleton, motion, denoiser.device)
    frame_times = np.arange(motion.frames) * (MODEL_FPS / motion.fps)
    times = frame_times
    if denoiser.start == "mended" and motion.fps > _FAST * MODEL_FPS:
        times = np.append(np.arange(0.0, frame_times[-1] - 0.5), frame_times[-1])
    at_frames, at_times = (torch.as_tensor(each, device=denoiser.device) for each in (frame_times, times))
    seen = pose if len(times) == len(frame_times) else pose.at(at_frames, at_times)
    found = corrections_by(DenoisedClouds(denoiser), scene_of(seen, times, motion.fps), options)
    turns, shifts = trusted(found, options)
    if seen is not pose:
        values = interpolate_values(torch.cat([turns.flatten(1), shifts], -1), at_times, at_frames, smooth=1.0)
        turns, shifts = values[:, :-3].unflatten(-1, (-1, 3)), values[:, -3:]
    return pose.corrected(turns, shifts).motion(motion.fps)


def trusted(found: Corrections, options: LatentOptions) -> tuple[Tensor, Tensor]:
    """Turns (T, J, 3) and shifts (T, 3) without what is as small as the networks' own errors."""

    def shrunk(values: Tensor, floor: float) -> Tensor:
        power = uniform_filter1d(values.square().sum(-1).cpu().numpy(), options.floor_frames, axis=0, mode="nearest")
        share = np.clip(1 - floor**2 / np.maximum(power, 1e-20), 0.0, 1.0)
        return values * torch.as_tensor(share, dtype=values.dtype, device=values.device).unsqueeze(-1)

    return shrunk(found.turns, options.turn_floor_rad), shrunk(found.shifts, options.shift_floor_m)


def scene_of(pose: SkeletonPose, times: np.ndarray, fps: float) -> Scene:
    """A clip without keys: every frame may change. times (T,) model frames, rising."""
    return Scene(Tokens(times, np.zeros(len(times), bool), fps), pose.by_local())


def corrections_by(source: CloudSource, scene: Scene, options: LatentOptions) -> Corrections:
    """The corrections of a scene's pose that a source of clouds asks for, in blocks of frames."""
    with torch.no_grad():
        clouds = source.find(scene, Drawing(options.points, options.sigma_m, options.views, options.seed))
        parts = [
            _solved(scene, clouds, first, min(first + CHUNK_TOKENS, len(scene.times)), options.solve)
            for first in range(0, len(scene.times), CHUNK_TOKENS)
        ]
    joined = (torch.cat(each) for each in zip(*((p.turns, p.shifts, p.residual) for p in parts), strict=True))
    turns, shifts, residual = joined
    return Corrections(turns, shifts, parts[0].seen, residual)


def _solved(scene: Scene, clouds: Clouds, first: int, last: int, options: SolveOptions) -> Corrections:
    points, reference = clouds.at(first, last, np.ones(last - first, bool))
    base, binding = scene.base.rows(slice(first, last)), clouds.binding
    targets = points if reference is None else carry_points(binding, *base.world()) + (points - reference)
    return solve_pose(targets, binding, *base.parts, scene.skeleton.parents, scene.skeleton.root, options)


@dataclass(frozen=True)
class TrueDifferences:
    """Points on the true motion and the same points on the scene's, to measure the error of the solve alone."""

    truth: SkeletonPose
    exact: bool = True
    glide: None = None
    confidence: None = None

    def find(self, scene: Scene, drawing: Drawing) -> Clouds:
        drawn = followed_points(scene, drawing)
        one = torch.ones(len(drawn.bones), device=scene.device)
        binding = Binding(drawn.bones.long(), drawn.in_bone, one, torch.zeros_like(one))

        def points_at(first: int, last: int, needed: np.ndarray) -> tuple[Tensor, None]:
            return place_on_pose(drawn, self.truth.rows(slice(first, last)), scene.skeleton), None

        return Clouds(binding, points_at)


@dataclass(frozen=True)
class DenoisedClouds:
    """Clouds of the latents that a denoiser makes of those of the scene's pose."""

    denoiser: LatentDenoiser
    exact: bool = False
    glide: None = None
    confidence: None = None

    def find(self, scene: Scene, drawing: Drawing) -> Clouds:
        coder, times = self.denoiser.autoencoder, scene.times
        seen = drawn_views(coder, scene, drawing)

        def corrected(plain: Pair, rows: slice, own: list[Span]) -> Pair:
            return self.denoiser.corrected(*plain, times[rows], own)

        latents_of = corrected_in_windows(coder, scene, seen, self.denoiser.spans(len(times)), corrected)
        return decoded_clouds(coder, scene, drawing, [view for view, _ in seen], latents_of)
