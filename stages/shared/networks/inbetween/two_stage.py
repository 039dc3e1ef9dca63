"""The two-stage transformer (Qin et al., Motion In-Betweening via Two-Stage Transformers, 2022).

A context network makes a rough motion from the keys; a detail network refines it. Attention has learned relative
positions; a frame's distances to its keys are encoded by a small network. The paper trains the networks one after
the other; here both train at once, and the detail network's gradient does not reach the context network. Foot
contacts are left out.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from stages.shared.networks.inbetween.method import Gaps, Method, Paper
from stages.shared.networks.inbetween.pose_space import PoseSpace
from stages.shared.networks.layers.attention import ExactNorm
from stages.shared.networks.layers.relative_attention import RelativeLayer
from stages.shared.networks.layers.sizes import MethodSizes
from stages.shared.networks.pumps.synthesiser import place_in_gap

_LONGEST = 64  # frames apart that attention distinguishes
_SMOOTHNESS = 0.5  # weight of positions' change from frame to frame; 0.005 a centimetre in the authors' settings


class _Stage(nn.Module):
    def __init__(self, space: PoseSpace, sizes: MethodSizes):
        super().__init__()
        self.embed = nn.Sequential(
            nn.Linear(space.width + 1, sizes.width), nn.PReLU(), nn.Linear(sizes.width, sizes.width)
        )
        self.place = nn.Sequential(nn.Linear(8, sizes.width), nn.PReLU(), nn.Linear(sizes.width, sizes.width))
        self.layers = nn.ModuleList(RelativeLayer(sizes.width, sizes.heads, _LONGEST) for _ in range(sizes.layers))
        self.out = nn.Sequential(ExactNorm(sizes.width), nn.Linear(sizes.width, space.width))

    def forward(self, poses: Tensor, gaps: Gaps, readable: Tensor) -> Tensor:
        """Poses (B, T, D) of all frames. readable: (B, T) frames that may be attended to."""
        frames = self.embed(torch.cat([poses, gaps.known.unsqueeze(-1).to(poses.dtype)], dim=-1))
        frames = frames + self.place(place_in_gap(gaps.known, gaps.times.expand_as(gaps.known)))
        for layer in self.layers:
            frames = layer(frames, gaps.times, known=readable)
        return self.out(frames)


class TwoStage(Method):
    """Context, then detail."""

    PAPER = Paper(
        MethodSizes(width=512, layers=6, heads=8),
        learning_rate=1e-4,
        batch=32,
        source="victorqin/motion_inbetweening, configs/lafan1_context_model.json and lafan1_detail_model.json",
    )

    def __init__(self, space: PoseSpace, sizes: MethodSizes):
        super().__init__(space, sizes)
        self.context, self.detail = _Stage(space, sizes), _Stage(space, sizes)

    def _stages(self, gaps: Gaps) -> tuple[Tensor, Tensor]:
        rough = gaps.with_keys(self.context(gaps.poses, gaps, gaps.known))
        return rough, gaps.with_keys(self.detail(rough.detach(), gaps, gaps.valid))

    def fill(self, gaps: Gaps) -> Tensor:
        return self._stages(gaps)[1]

    def fit(self, gaps: Gaps, truth: Tensor, generator: torch.Generator) -> tuple[Tensor, dict[str, Tensor]]:
        """Both stages' L1 of vectors, rotations and positions, and the smoothness of positions."""
        losses = []
        for made in self._stages(gaps):
            heads, _ = self.space.joints(made, gaps.offsets)
            steps = nn.functional.pad((heads[:, 1:] - heads[:, :-1]).abs(), (0, 0, 0, 0, 1, 0))
            near = gaps.mean((made - truth).abs()) + self.pose_loss(gaps, made, truth)
            losses.append(near + _SMOOTHNESS * gaps.mean(steps))
        return losses[0] + losses[1], {"context": losses[0], "detail": losses[1]}
