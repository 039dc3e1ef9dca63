"""A lifted pose moved to where the keypoints are: a short optimisation of rotations, path and proportions.

The network's pose is the prior. What moves is how far the pose differs from it: rotations in the parents' frames,
smooth over time; the path; and one factor each on the lengths of trunk, arms and legs, since the person in the image
is not built as the rig.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from stages.shared.kinematics.cameras import level_camera, projected
from stages.shared.kinematics.forward import global_rotations, local_rotations
from stages.shared.kinematics.rotations import conjugate, from_turn_vectors, multiply, rotate
from stages.shared.pointcloud.rig import RigBody, pose_heads
from stages.shared.solve.reprojection import BEND_M, SolvedView

_SEEN_M = 0.03  # standard deviation of a keypoint, at the body's distance
_TURN_RAD = 0.3  # of a joint's rotation from the network's
_BEND_RAD = 0.02  # of the second difference of that, at 30 frames a second
_LENGTH = 0.08  # of the logarithm of a factor on lengths
_ROBUST = 2.0  # standard deviations from which a keypoint counts less
_STEPS, _RATE = 60, 0.04
_PARTS = (0, 1, 1, 2, 2)  # of the body groups: trunk, arms, legs


def refine_pose(
    body: RigBody,
    landmarks: tuple[np.ndarray, np.ndarray],
    rotations: Tensor,
    view: SolvedView,
    rays: np.ndarray,
    trust: np.ndarray,
    *,
    steps: int = _STEPS,
) -> Tensor:
    """The rotations (T, J, 4) of a refined pose seen by a known camera. Time and memory are linear in T.

    Args:
        landmarks: (L,) bones and (L, 3) places on them. rotations: (T, J, 4) global, in the level frame.
        view: the camera, and the path to start from.
        rays: (T, L, 2), NaN where missing. trust: (T, L) confidences, 0 where missing.
    """
    bones, places = landmarks[0], torch.from_numpy(landmarks[1]).float()
    there = torch.from_numpy(np.where(np.isfinite(rays).all(-1), trust, 0.0)).float()
    wanted = torch.from_numpy(np.nan_to_num(rays) / view.zoom).float()
    turn = torch.from_numpy(conjugate(level_camera(np.array(view.pitch), np.array(view.roll)))).float()
    start, path0 = local_rotations(rotations, body.parents), torch.from_numpy(view.path).float()
    depth = (-path0[:, 2:]).clamp_min(0.3)
    turns = torch.zeros(*start.shape[:2], 3, requires_grad=True)
    shift = torch.zeros_like(path0, requires_grad=True)
    lengths = torch.zeros(3, requires_grad=True)
    part = torch.tensor(_PARTS)[body.groups.clamp_min(0)]
    above = torch.as_tensor(body.parents.clip(0))

    def posed() -> tuple[Tensor, Tensor]:
        world = global_rotations(multiply(start, from_turn_vectors(turns)), body.parents)
        factors = lengths.exp()[part]
        heads = pose_heads(replace(body, offsets=body.offsets * factors[above, None]), path0 + shift, world)
        held = (places * factors[bones, None]).expand(len(world), -1, 3)
        return world, heads[:, bones] + rotate(world[:, bones], held)

    optimiser = torch.optim.Adam([turns, shift, lengths], lr=_RATE)
    for step in range(steps):
        for group in optimiser.param_groups:
            group["lr"] = _RATE * (1 - step / steps) ** 0.5
        _, points = posed()
        seen = projected(rotate(turn.expand(*points.shape[:2], 4), points))
        apart = (seen - wanted) * depth.unsqueeze(1) / _SEEN_M
        # Soft L1: beyond `_ROBUST` the pull no longer grows.
        error = 2 * _ROBUST**2 * ((1 + apart.square().sum(-1) / _ROBUST**2).sqrt() - 1)
        terms = [(there * error).sum(), (turns / _TURN_RAD).square().sum(), (lengths / _LENGTH).square().sum()]
        if len(turns) > 2:
            bend = turns[2:] - 2 * turns[1:-1] + turns[:-2]
            moved = path0 + shift
            curve = moved[2:] - 2 * moved[1:-1] + moved[:-2]
            terms += [(bend / _BEND_RAD).square().sum(), (curve / BEND_M).square().sum()]
        optimiser.zero_grad()
        (torch.stack(terms).sum() / len(turns)).backward()
        optimiser.step()
    with torch.no_grad():
        return posed()[0]
