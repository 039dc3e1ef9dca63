"""Draws of points, and their positions over time (PC-MRL eq. 3, PUMPS 4.2).

A point is fixed to one bone: it is drawn once in the bone's frame, and its trajectory follows from the bone's
transforms. So one batched transform computes a cloud from a motion.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from stages.shared.kinematics.rotations import matrices


def draw_points(
    weights: np.ndarray, points: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw points on bones, with probability proportional to `weights`.

    Args:
        weights: (B,) the bones' weights, their lengths in the papers; 0 is never drawn.
        points: number of points, P.

    Returns: bones (P,) int32; alphas (P,) float32 uniform on [0, 1] from head to tail; offsets (P, 3) float32
        standard normal, to be scaled by sigma.
    """
    share = np.asarray(weights, dtype=np.float64)
    bones = rng.choice(len(share), size=points, p=share / share.sum()).astype(np.int32)
    alphas = rng.uniform(0.0, 1.0, points).astype(np.float32)
    offsets = rng.standard_normal((points, 3)).astype(np.float32)
    return bones, alphas, offsets


def spread_points(weights: Tensor, points: int, start: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Points spread evenly: a systematic sample of the distribution of `draw_points`.

    The bones are laid end to end, each as long as its weight, and every P-th part of that line holds one point;
    offsets are the Sobol sequence, which fills the cube evenly, through the normal distribution's inverse. The latent
    of such a cloud depends on the pose, and hardly on the draw.

    Args:
        weights: (..., J) the bones' weights; 0 is never drawn.
        start: (...) in [0, 1), the position of each point in its part of the line.

    Returns: bones (..., P) int64, alphas (..., P) and offsets (..., P, 3), as of `draw_points`.
    """
    ends = weights.double().cumsum(-1)
    order = torch.arange(points, dtype=torch.float64, device=weights.device)
    place = (order + start.double().unsqueeze(-1)) / points * ends[..., -1:]
    place = torch.minimum(place, torch.nextafter(ends[..., -1:], torch.zeros_like(ends[..., -1:])))
    bones = torch.searchsorted(ends, place.contiguous(), right=True)
    length = torch.gather(weights.double(), -1, bones)
    alphas = (place - torch.gather(ends, -1, bones) + length) / length
    offsets = _even_normals(points).to(weights.device).expand(*bones.shape, 3)
    return bones, alphas.clamp(0, 1).float(), offsets


@lru_cache(maxsize=8)
def _even_normals(points: int) -> Tensor:
    """(P, 3) float32 of the standard normal distribution, spread as evenly as possible."""
    # With 2^m points every coordinate has each multiple of 2^-m once; half a step is added to centre them.
    steps = 1 << max(points - 1, 1).bit_length()
    cube = torch.quasirandom.SobolEngine(3).draw(steps, dtype=torch.float64)[:points] + 0.5 / steps
    return torch.special.ndtri(cube).float()


def points_in_bone(tails: Tensor, bones: Tensor, alphas: Tensor, offsets: Tensor, sigma_m: Tensor | float) -> Tensor:
    """H_x ~ N(alpha T_n, sigma) of PC-MRL eq. 3: drawn points in their bones' frames.

    Args:
        tails: (..., J, 3) metres.
        bones: (..., P) index into the bones.
        alphas: (..., P).
        offsets: (..., P, 3) standard normal.
        sigma_m: a number, or (...) with one for each cloud.

    Returns: (..., P, 3) metres.
    """
    tail = torch.gather(tails, -2, bones.long().unsqueeze(-1).expand(*bones.shape, 3))
    sigma = torch.as_tensor(sigma_m, dtype=tails.dtype, device=tails.device)[..., None, None]
    return alphas.unsqueeze(-1) * tail + sigma * offsets


def place_points(heads: Tensor, rotations: Tensor, bones: Tensor, in_bone: Tensor) -> Tensor:
    """p_u,t = p_n,t + QR(H_x, q_n,t) of PC-MRL eq. 3: points in the world.

    Args:
        heads: (..., T, J, 3) bones' heads, metres.
        rotations: (..., T, J, 4) bones' global rotations, xyzw.
        bones: (..., P).
        in_bone: (..., P, 3) metres.

    Returns: (..., T, P, 3) metres.
    """
    # Turning a bone's frame into a matrix once costs J products; turning P quaternions costs P of them.
    frames = torch.cat([matrices(rotations), heads.unsqueeze(-1)], dim=-1)  # (..., T, J, 3, 4)
    index = bones.long()[..., None, :, None, None].expand(*heads.shape[:-2], bones.shape[-1], 3, 4)
    chosen = torch.gather(frames, -3, index)  # (..., T, P, 3, 4)
    return (chosen[..., :3] @ in_bone[..., None, :, :, None]).squeeze(-1) + chosen[..., 3]
