"""The scale of a cloud's body relative to the skeleton, and its position, from frames with a known pose.

    cloud point at key k  =  scale * (head of its bone) + (rotation of its bone) (its position there) + shift k

The scale is estimated from two quantities. The first is the spread of the cloud, compared with the spread of points
drawn on the skeleton in the same pose; its error is a few per cent, with a single key. The second is the movement of
points from key to key when their bones turn, which does not depend on the draw of the points; it is exact if the keys
differ enough.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from data_schemas.errors import InputError
from data_schemas.skeleton import BODY_GROUPS, Skeleton
from stages.shared.kinematics.plain_interpolation import interpolate_values
from stages.shared.kinematics.rotations import matrices, rotate
from stages.shared.solve.binding import MOST_FRAMES, bind_points

SPREAD_TRUST = 0.03  # relative error of the scale from the spread alone
POINT_TRUST_M = 0.02  # how far points may move on their bones, if motion gives the scale
REFITS = 3  # number of bindings; each uses the scale from the one before
SHIFT_BELIEF = 1e-3  # weight of the assumption that the cloud's centroid is the drawn points' centroid, in points
SIGMA_M = 0.05  # expected spread of points around their bones


class CloudFit(NamedTuple):
    """scale: cloud lengths over the skeleton's. shifts: (K, 3) metres, of the keys, in the cloud's world."""

    scale: float
    shifts: Tensor

    def to_skeleton(self, points: Tensor, times: Tensor, key_times: Tensor) -> Tensor:
        """Points (T, P, 3) in the skeleton's size and position; shifts are linear between keys."""
        shifts = interpolate_values(self.shifts, key_times, times)
        return (points - shifts.unsqueeze(1)) / self.scale


def fit_cloud(
    points: Tensor,
    groups: Tensor,
    skeleton: Skeleton,
    heads: Tensor,
    rotations: Tensor,
    *,
    scale: float | None = None,
) -> CloudFit:
    """The scale and position of a cloud's body relative to a skeleton.

    Args:
        points: (K, P, 3) the cloud at K >= 1 keys, metres. groups: (P,).
        heads: (K, J, 3), rotations: (K, J, 4) the skeleton's pose at these keys, global.
        scale: the scale, if it is known; then only the shifts are found.

    Raises: InputError if the cloud and the skeleton share no body group.
    """
    expected = _expected(groups, skeleton, heads, rotations)
    middle = (expected.weights[:, None] * points).sum(1)
    first = spread_scale(points, groups, skeleton, heads, rotations) if scale is None else scale
    some = torch.arange(len(points), device=points.device)
    if len(points) > MOST_FRAMES:
        some = torch.linspace(0, len(points) - 1, MOST_FRAMES, device=points.device).round().long()
    turned = matrices(rotations)
    around, centred = points - middle.unsqueeze(1), heads - expected.middle.unsqueeze(1)
    size, shifts = first, torch.zeros_like(middle)
    for _ in range(REFITS):
        placed = (around - shifts.unsqueeze(1)) / size
        binding = bind_points(placed[some], groups, skeleton, centred[some], rotations[some])
        bones, frames = centred[:, binding.joints], turned[:, binding.joints]
        weight = binding.weights / binding.weights.sum().clamp(min=1e-12)
        size, place = _refined(around[some], bones[some], frames[some], weight, first, fixed=scale is not None)
        carried = size * bones + (frames @ place.unsqueeze(-1)).squeeze(-1)
        shifts = (weight[:, None] * (around - carried)).sum(1)
    return CloudFit(size, middle + shifts - size * expected.middle)


def spread_scale(points: Tensor, groups: Tensor, skeleton: Skeleton, heads: Tensor, rotations: Tensor) -> float:
    """The scale from the spread of the cloud alone, if no motion gives it: the root mean square distance from its
    centroid, divided by that of points drawn on the skeleton in the same poses. Arguments as for `fit_cloud`.
    """
    expected = _expected(groups, skeleton, heads, rotations)
    middle = (expected.weights[:, None] * points).sum(1, keepdim=True)
    own = (expected.weights * (points - middle).square().sum(-1)).sum(-1).mean()
    return float((own / expected.variance).sqrt())


class _Expected(NamedTuple):
    """Centroid (K, 3) of points drawn on the skeleton, as many of each body group as the cloud has, and their mean
    squared distance from it. weights: (P,) of the cloud's points, zero in groups that the skeleton lacks.
    """

    weights: Tensor
    middle: Tensor
    variance: Tensor


def _expected(groups: Tensor, skeleton: Skeleton, heads: Tensor, rotations: Tensor) -> _Expected:
    lengths = np.linalg.norm(skeleton.tails, axis=-1) * skeleton.sampled
    of_group = groups.cpu().numpy()
    shared = [g for g in range(len(BODY_GROUPS)) if (of_group == g).any() and lengths[skeleton.groups == g].sum() > 0]
    if not shared:
        raise InputError(
            "The cloud and the skeleton share no body group, so that their scale cannot be found.",
            "Check the skeleton's body groups with pumps inspect.",
        )
    own = np.isin(of_group, shared)
    chance = np.zeros(skeleton.joints)
    for g in shared:
        members = skeleton.groups == g
        chance[members] = (of_group == g).sum() / own.sum() * lengths[members] / lengths[members].sum()
    chances = torch.as_tensor(chance, dtype=heads.dtype, device=heads.device)
    tails = torch.as_tensor(skeleton.tails, dtype=heads.dtype, device=heads.device)
    middles = heads + rotate(rotations, tails.expand_as(heads)) / 2
    centre = (chances[:, None] * middles).sum(1)
    across = (chances * (middles - centre.unsqueeze(1)).square().sum(-1)).sum(-1).mean()
    around = float((chance * (lengths**2 / 12 + 3 * SIGMA_M**2)).sum())
    weights = torch.as_tensor(own / own.sum(), dtype=heads.dtype, device=heads.device)
    return _Expected(weights, centre, across + around)


def _refined(
    points: Tensor, bones: Tensor, turned: Tensor, weight: Tensor, first: float, *, fixed: bool
) -> tuple[float, Tensor]:
    """The scale and the points' positions (P, 3) in their bones, by least squares.

    Shifts and positions are eliminated from the points (K, P, 3) and from the bones' heads (K, P, 3). The scale is
    the regression of the points' remaining motion on the heads' remaining motion. `first` counts as one more
    observation.
    """
    moving, heads_shift = _unexplained(bones, turned, weight)
    seen, points_shift = _unexplained(points, turned, weight)
    trust = (POINT_TRUST_M / (SPREAD_TRUST * first)) ** 2 / len(weight)
    pulled, power = ((weight[:, None] * moving * other).sum() for other in (seen, moving))
    scale = first if fixed else float((pulled + trust * first) / (power + trust))
    left = points - scale * bones - (points_shift - scale * heads_shift).unsqueeze(1)
    return scale, (turned.transpose(-1, -2) @ left.unsqueeze(-1)).mean(0).squeeze(-1)


def _unexplained(field: Tensor, turned: Tensor, weight: Tensor) -> tuple[Tensor, Tensor]:
    """The residual of (K, P, 3) after a shift (K, 3) of each key and a fixed position of each point in its bone, and
    the shifts.

    Positions are means over keys in the bones' frames, so only the shifts must be solved for.
    """
    keys = len(field)

    def without_places(values: Tensor) -> Tensor:
        inside = (turned.transpose(-1, -2) @ values.unsqueeze(-1)).mean(0)
        return values - (turned @ inside).squeeze(-1)

    # Row block k, column block l: 1 where k = l, less the mean of R_k R_l' over points, over the number of keys.
    flat = turned.permute(0, 2, 1, 3).reshape(3 * keys, -1)  # rows (k, i), columns (point, j)
    both = (flat * weight.repeat_interleave(3)) @ flat.T / keys
    normal = torch.eye(3 * keys, device=field.device) * (1 + SHIFT_BELIEF) - both
    pull = (weight[:, None] * without_places(field)).sum(1)
    shifts = torch.linalg.solve(normal.double(), pull.flatten().double()).float().view(keys, 3)
    return without_places(field - shifts.unsqueeze(1)), shifts
