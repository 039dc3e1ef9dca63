"""Clouds that an autoencoder decodes: views of a clip, turned and mirrored, and their points where needed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from data_schemas.skeleton import Skeleton
from stages.shared.inference.cloud_interfaces import CloudAutoencoder, Clouds, Drawing, Pair, Scene
from stages.shared.inference.clouds import BLOCK_TOKENS, place_on_pose
from stages.shared.inference.models import Span, reach_of, touching
from stages.shared.kinematics.conventions import MIRRORED_GROUP
from stages.shared.pointcloud.drawn_points import DrawnPoints, draw_on_skeleton, spread_on_skeleton
from stages.shared.pointcloud.heading import turned
from stages.shared.solve.binding import bind_points
from stages.shared.solve.skeleton_pose import SkeletonPose

# A view's number, first and last (excluded) token, and whether better latents are wanted -> those of the target
# (without them, anything) and those of the base.
LatentsOf = Callable[[int, int, int, bool], tuple[Pair, Pair]]


class View(NamedTuple):
    """A view of a clip: turned by `yaw` radians about the vertical, then mirrored left to right or not."""

    yaw: float
    mirrored: bool

    def groups(self, groups: Tensor) -> Tensor:
        """The body groups in this view."""
        return torch.tensor(MIRRORED_GROUP, device=groups.device)[groups.long()] if self.mirrored else groups

    def encode(
        self, coder: CloudAutoencoder, pose: SkeletonPose, drawn: DrawnPoints, skeleton: Skeleton
    ) -> tuple[Tensor, Tensor]:
        """Latents (T, D) and centroids (T, 3), in this view, of drawn points on a pose."""
        points = turned(place_on_pose(drawn, pose, skeleton), torch.tensor(self.yaw))
        return coder.encode(self._sided(points), self.groups(drawn.groups))

    def decode(
        self,
        coder: CloudAutoencoder,
        given: tuple[Tensor, Tensor],
        times: Tensor,
        groups: Tensor,
        noise: Tensor,
        spans: Sequence[Span] | None = None,
    ) -> Tensor:
        """Points (T, P, 3), turned back to the world, of latents and centroids in this view; in these windows."""
        made = coder.decode(*given, times, self.groups(groups), noise, spans)
        return turned(self._sided(made), torch.tensor(-self.yaw))

    def _sided(self, points: Tensor) -> Tensor:
        return points * points.new_tensor([-1.0, 1.0, 1.0]) if self.mirrored else points


def views_of(count: int) -> list[View]:
    """Views evenly around the clip, every other one mirrored."""
    return [View(2 * math.pi * number / count, number % 2 == 1) for number in range(count)]


def followed_points(scene: Scene, drawing: Drawing) -> DrawnPoints:
    """The points that the solve follows: the true ones, or as many decoded ones of the same body groups."""
    rng = np.random.default_rng(drawing.seed)
    return draw_on_skeleton(scene.skeleton, drawing.points, rng, drawing.sigma_m, scene.device)


def drawn_views(coder: CloudAutoencoder, scene: Scene, drawing: Drawing) -> list[tuple[View, DrawnPoints]]:
    """Views of the clip, and for each the points that are encoded."""
    count = max(drawing.views, 1)
    starts = (np.arange(count) + 0.5) / count
    drawn = [spread_on_skeleton(scene.skeleton, coder.points, at, drawing.sigma_m, scene.device) for at in starts]
    return list(zip(views_of(count), drawn, strict=True))


def encoded_in_view(
    coder: CloudAutoencoder, pose: SkeletonPose, view: View, drawn: DrawnPoints, first: int, last: int
) -> Pair:
    """Latents and centroids of drawn points on some tokens of a pose, in a view."""
    return view.encode(coder, pose.rows(slice(first, last)), drawn, pose.skeleton)


def corrected_in_windows(
    coder: CloudAutoencoder,
    scene: Scene,
    seen: Sequence[tuple[View, DrawnPoints]],
    windows: Sequence[Span],
    corrected: Callable[[Pair, slice, list[Span]], Pair],
) -> LatentsOf:
    """The latents of the scene's base in each view, and a network's corrections of them.

    Args:
        seen: `drawn_views`. windows: in which the network corrects the clip.
        corrected: latents and centroids of some tokens, these tokens, and windows in them -> those corrected.
    """

    def latents_of(number: int, first: int, last: int, better: bool) -> tuple[Pair, Pair]:
        some = touching(windows, first, last) if better else []
        low, high = reach_of(some, first, last)
        plain = encoded_in_view(coder, scene.base, *seen[number], low, high)
        made = corrected(plain, slice(low, high), [span.moved(-low) for span in some]) if some else plain
        inner = slice(first - low, last - low)
        return (made[0][inner], made[1][inner]), (plain[0][inner], plain[1][inner])

    return latents_of


def decoded_clouds(
    coder: CloudAutoencoder, scene: Scene, drawing: Drawing, views: Sequence[View], latents_of: LatentsOf
) -> Clouds:
    """Decode each view's latents of the clip and of its plain interpolation, as many tokens as are asked for.

    The models were trained on all headings and on mirrored motion, so every view is equally good, and the errors of
    the views are largely independent. Each view decodes its share of the followed points, so the solve takes their
    mean. Tokens are decoded in the windows of the whole clip, so points do not depend on which others are asked for.
    """
    groups = followed_points(scene, drawing).groups
    noise = coder.draw_noise(len(groups), drawing.seed)
    total = len(scene.times)
    windows, times = coder.spans(total), scene.times

    def decoded(first: int, last: int, needed: np.ndarray, shown: np.ndarray) -> tuple[Tensor, Tensor]:
        """Points where they are `needed`, reference there and where it is `shown`: (last - first, P, 3) each."""
        some = [touching(windows, first, last, rows) for rows in (needed, needed | shown)]
        low, high = reach_of(some[1], first, last)
        points, reference = (torch.zeros(last - first, len(groups), 3, device=scene.device) for _ in range(2))
        inner = slice(first - low, last - low)
        for number, view in enumerate(views):
            own = slice(number, None, len(views))
            pairs = latents_of(number, low, high, bool(some[0]))
            for out, given, asked in zip((points, reference), pairs, some, strict=True):
                if asked:
                    spans = [span.moved(-low) for span in asked]
                    made = view.decode(coder, given, times[low:high], groups[own], noise[own], spans)
                    out[:, own] = made[inner].to(scene.device)
        return points, reference

    shown = scene.tokens.spread()
    nothing = np.zeros(total, bool)
    whole = total <= BLOCK_TOKENS
    if whole:  # found at once, and kept
        kept = decoded(0, total, scene.tokens.around_gaps(), np.isin(np.arange(total), shown))
        reference = kept[1][torch.as_tensor(shown, device=scene.device)]
    else:
        one = np.ones(1, bool)
        reference = torch.cat([decoded(at, at + 1, ~one, one)[1] for at in shown.tolist()])
    rows = torch.as_tensor(shown, device=scene.device)
    binding = bind_points(reference, groups, scene.skeleton, *scene.base.rows(rows).world())

    def points_at(first: int, last: int, needed: np.ndarray) -> tuple[Tensor, Tensor]:
        if whole:
            return kept[0][first:last], kept[1][first:last]
        return decoded(first, last, needed, nothing[first:last])

    return Clouds(binding, points_at)
