"""Clean a motion of any rig by latents: its cloud is encoded, a denoiser corrects the latents, both are decoded with the
same point identities, and the difference of the two decodings moves the points of the motion, which the solve follows.

    latents of the motion -> corrected latents -> difference of the decoded clouds -> solve, the motion as its prior

As in filling, only the difference of two decodings counts, so constant errors of the autoencoder cancel.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from stages.shared.inference.cloud_interfaces import Clouds, CloudSource, Drawing, Scene
from stages.shared.inference.clouds import CHUNK_TOKENS, place_on_pose
from stages.shared.inference.decoded_clouds import followed_points
from stages.shared.inference.token_times import Tokens
from stages.shared.kinematics.rotations import matrices
from stages.shared.solve.binding import Binding
from stages.shared.solve.skeleton_pose import SkeletonPose
from stages.shared.solve.solving import Corrections, SolveOptions, solve_pose


@dataclass(frozen=True)
class LatentOptions:
    """solve: weights of the points against the motion. sigma_m: spread of the points around the bones, metres.
    views: how often the networks see the clip, turned and mirrored. points: of the cloud that the solve follows."""

    solve: SolveOptions = field(default_factory=SolveOptions)
    sigma_m: float = 0.05
    views: int = 2
    points: int = 256
    seed: int = 0


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
    heads, rotations = base.world()
    bound = heads[:, binding.joints] + (
        matrices(rotations)[:, binding.joints] @ binding.in_bone.unsqueeze(-1)
    ).squeeze(-1)
    targets = points if reference is None else bound + (points - reference)
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
