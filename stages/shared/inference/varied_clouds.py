"""Clouds of another plausible motion: a fill's latents with a residual drawn for each gap, decoded beside them.

Each gap is seen from where the body faces +Z halfway through it, as the residuals were measured. The difference of
the two decodings moves the points, so the autoencoder's own errors cancel, and nothing moves without a residual.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from data_schemas.skeleton import Skeleton
from stages.shared.inference.cloud_interfaces import CloudAutoencoder, Clouds, Drawing, Pair, Scene
from stages.shared.inference.clouds import BLOCK_TOKENS, place_on_pose
from stages.shared.inference.decoded_clouds import followed_points
from stages.shared.inference.token_times import Tokens
from stages.shared.inference.variation import GapPath, Variation
from stages.shared.pointcloud.drawn_points import DrawnPoints, spread_on_skeleton
from stages.shared.pointcloud.heading import headings_of, turned
from stages.shared.solve.binding import bind_points
from stages.shared.solve.skeleton_pose import SkeletonPose

CONTEXT = 8  # tokens on both sides of a gap that are decoded with it
_BOUND_GAPS = 8  # whose points are bound to bones
_NEAR = 2.0  # model frames; known tokens that are further apart give no velocity
_FACING = 4  # tokens on both sides of a gap's middle, over which the direction that the body faces is averaged


@dataclass(frozen=True)
class VariedClouds:
    """Clouds around a fill, which is the scene's base.

    seeds: of the residuals; each gap has its own draw.
    """

    autoencoder: CloudAutoencoder
    variation: Variation
    seeds: tuple[int, ...]

    def find(self, scene: Scene, drawing: Drawing) -> Clouds:
        gaps = scene.tokens.gaps()
        groups = followed_points(scene, drawing).groups
        noise = self.autoencoder.draw_noise(len(groups), drawing.seed)
        drawn = drawn_evenly(self.autoencoder, scene.skeleton, drawing.sigma_m, scene.device)
        kept: dict[int, _Decoded] = {}

        def decoded(number: int) -> _Decoded:
            if number in kept:
                return kept[number]
            made = self._decoded(scene, gaps[number], number, drawn, groups, noise)
            if len(scene.times) <= BLOCK_TOKENS:  # all gaps of a longer clip would take much memory
                kept[number] = made
            return made

        def points_at(first: int, last: int, needed: np.ndarray) -> tuple[Tensor, Tensor]:
            points, reference = (torch.zeros(last - first, len(groups), 3, device=scene.device) for _ in range(2))
            for number, gap in enumerate(gaps):
                low, high = max(int(gap[0]) - 1, first), min(int(gap[-1]) + 2, last)
                if low < high:  # of a key between two gaps, the second decoding replaces the first
                    made = decoded(number)
                    own = slice(low - made.first, high - made.first)
                    points[low - first : high - first] = made.points[own]
                    reference[low - first : high - first] = made.reference[own]
            return points, reference

        some = np.unique(np.linspace(0, len(gaps) - 1, _BOUND_GAPS).round().astype(int))
        rows = torch.as_tensor(np.concatenate([gaps[number] for number in some]), device=scene.device)
        found = [decoded(number) for number in some]
        still = [made.reference[gaps[number] - made.first] for number, made in zip(some, found, strict=True)]
        binding = bind_points(torch.cat(still), groups, scene.skeleton, *scene.base.rows(rows).world())
        return Clouds(binding, points_at)

    def _decoded(
        self, scene: Scene, gap: np.ndarray, number: int, drawn: DrawnPoints, groups: Tensor, noise: Tensor
    ) -> _Decoded:
        coder, times = self.autoencoder, scene.times
        view = gap_view(scene.base, scene.tokens, gap, drawn, CONTEXT)
        plain = encoded_gap(coder, scene.base, view, drawn)
        path = view.path(scene.tokens, gap, plain[0])
        residual = self.variation.draw(path, np.random.default_rng([*self.seeds, number]))
        inside = torch.as_tensor(gap - view.rows.start, device=scene.device)
        varied = plain[0].clone(), plain[1].clone()
        for values, added in zip(varied, residual, strict=True):
            values[inside] += torch.from_numpy(added).to(values)
        clouds = [
            turned(coder.decode(*pair, times[view.rows], groups, noise), -view.yaw).to(scene.device)
            for pair in (varied, plain)
        ]
        return _Decoded(view.rows.start, *clouds)


class _Decoded(NamedTuple):
    """Tokens around a gap, from `first` on: points (n, P, 3) with a residual, and the same points without."""

    first: int
    points: Tensor
    reference: Tensor


class GapView(NamedTuple):
    """A stretch of tokens around a gap, which is turned by `yaw` radians about the vertical."""

    rows: slice
    yaw: Tensor

    def path(self, tokens: Tokens, gap: np.ndarray, latents: Tensor) -> GapPath:
        """What the residual's size depends on; `latents` (n, D) are those of all `rows`."""
        first, last = int(gap[0]), int(gap[-1])
        before = float(tokens.times[first - 1]) if first > 0 else None
        after = float(tokens.times[last + 1]) if last + 1 < len(tokens.times) else None
        own = slice(first - (before is not None), last + 1 + (after is not None))
        along = latents[own.start - self.rows.start : own.stop - self.rows.start]
        lone = [_is_lone(tokens, key, key - 1) for key in (first - 1,) if before is not None]
        lone += [_is_lone(tokens, key, key + 1) for key in (last + 1,) if after is not None]
        seen = along.double().cpu().numpy()
        return GapPath(tokens.times[gap], before, after, seen, tokens.times[own], float(np.mean(lone or [1.0])))


def _is_lone(tokens: Tokens, key: int, beyond: int) -> bool:
    """Whether `beyond`, the token on a key's other side, gives no velocity: it is not known, or too far away."""
    inside = 0 <= beyond < len(tokens.times) and bool(tokens.is_key[beyond])
    return not inside or abs(float(tokens.times[beyond] - tokens.times[key])) > _NEAR


def gap_view(pose: SkeletonPose, tokens: Tokens, gap: np.ndarray, drawn: DrawnPoints, context: int) -> GapView:
    """A gap (n,) of tokens with so many more on both sides, seen from where the body faces +Z halfway through it."""
    rows = slice(max(int(gap[0]) - context, 0), min(int(gap[-1]) + 1 + context, len(tokens.times)))
    middle = int(gap[len(gap) // 2])
    near = slice(max(middle - _FACING, 0), middle + _FACING + 1)
    points = place_on_pose(drawn, pose.rows(near), pose.skeleton)
    return GapView(rows, headings_of(points[None], drawn.groups[None])[0, middle - near.start])


def encoded_gap(coder: CloudAutoencoder, pose: SkeletonPose, view: GapView, drawn: DrawnPoints) -> Pair:
    """Latents and centroids of drawn points on a pose, in a view of a gap."""
    points = place_on_pose(drawn, pose.rows(view.rows), pose.skeleton)
    return coder.encode(turned(points, view.yaw), drawn.groups)


def drawn_evenly(
    coder: CloudAutoencoder, skeleton: Skeleton, sigma_m: float, device: torch.device | str
) -> DrawnPoints:
    """The points that are encoded, spread evenly over the bones."""
    return spread_on_skeleton(skeleton, coder.points, 0.5, sigma_m, device)
