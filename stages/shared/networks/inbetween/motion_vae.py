"""A variational prior of motion, descended at test time, in the manner of HuMoR (Rempe et al., ICCV 2021).

A conditional VAE learns the step from one pose to the next: an encoder reads both poses, a decoder makes the step
from the pose before and the code, and a network gives the codes' prior from the pose before. The negative evidence
bound of a motion's steps says how unusual the motion is. To clean a motion or fill a gap, gradient descent lowers
this bound, starting from the noisy motion or from the plain interpolation; a robust distance keeps the result near
the start.

HuMoR optimises the first pose and all codes through one long rollout. Here the poses of all frames are optimised at
once and the codes are the encoder's, so that the frames are computed side by side. Contacts and the floor are left
out.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from stages.shared.networks.inbetween.descent import descended
from stages.shared.networks.inbetween.method import Gaps, Method, Paper
from stages.shared.networks.inbetween.pose_space import PoseSpace
from stages.shared.networks.layers.sizes import MethodSizes

_CODE = 48  # numbers of a code, as in the paper
_DIVERGENCE = 4e-4  # weight of the codes' divergence from their prior, as in the paper
_STEPS, _RATE = 40, 0.05  # of the descent
_NEAR, _PRIOR, _SMOOTH, _ROBUST = 0.05, 1.0, 0.2, 0.3  # weights at test time; standard deviations of an outlier


class MotionVae(Method):
    """Encoder, decoder and prior, each a network of linear layers on standardised pose vectors."""

    descends = True
    PAPER = Paper(
        MethodSizes(width=1024, layers=3, heads=1),
        learning_rate=1e-4,
        batch=200,
        source="Rempe et al. 2021, section 3: codes of 48 numbers, layers of 1024, Adamax at 1e-4",
    )

    def __init__(self, space: PoseSpace, sizes: MethodSizes):
        super().__init__(space, sizes)
        pose = space.width
        self.encoder = _layers(2 * pose, 2 * _CODE, sizes)
        self.prior = _layers(pose, 2 * _CODE, sizes)
        self.decoder = _layers(pose + _CODE, pose, sizes)

    def bound(self, poses: Tensor, generator: torch.Generator | None = None) -> tuple[Tensor, Tensor]:
        """The squared error of each decoded step, and its code's divergence from the prior, (B, T - 1) each.

        Args:
            poses: (B, T, D) standardised. generator: draws the codes; without it they are the encoder's means.
        """
        before, after = self._near(poses[:, :-1]), self._near(poses[:, 1:], poses[:, :-1])
        mean, spread = self.encoder(torch.cat([before, after], dim=-1)).chunk(2, dim=-1)
        usual, usual_spread = self.prior(before).chunk(2, dim=-1)
        spread, usual_spread = spread.clamp(-8, 8), usual_spread.clamp(-8, 8)
        code = mean
        if generator is not None:
            code = mean + (spread / 2).exp() * torch.randn(
                mean.shape, generator=generator, device=mean.device, dtype=mean.dtype
            )
        step = self.decoder(torch.cat([before, code], dim=-1))
        error = (poses[:, :-1] + step - poses[:, 1:]).square().mean(-1)
        apart = (spread.exp() + (mean - usual).square()) / usual_spread.exp()
        return error, 0.5 * (usual_spread - spread + apart - 1).sum(-1)

    def _near(self, poses: Tensor, origin: Tensor | None = None) -> Tensor:
        """Poses (..., D) with the ground position taken from that of `origin`, or zero: steps do not depend on it."""
        from_root = poses.clone()
        for axis in (0, 2):
            from_root[..., axis] = 0.0 if origin is None else poses[..., axis] - origin[..., axis]
        return from_root

    def fit(self, gaps: Gaps, truth: Tensor, generator: torch.Generator) -> tuple[Tensor, dict[str, Tensor]]:
        """The negative evidence bound of the true steps, a mean over real ones."""
        error, divergence = self.bound(truth, generator)
        real = (gaps.valid[:, 1:] & gaps.valid[:, :-1]).to(error.dtype)
        error, divergence = ((each * real).sum() / real.sum().clamp_min(1) for each in (error, divergence))
        return error + _DIVERGENCE * divergence, {"step_error": error, "divergence": divergence}

    def fill(self, gaps: Gaps) -> Tensor:
        gate = gaps.missing.unsqueeze(-1).to(gaps.base.dtype)

        def unusual(moved: Tensor) -> Tensor:
            poses = gaps.base + gate * moved
            error, divergence = self.bound(poses)
            square = (gate * moved).square()
            near = (square / (square + _ROBUST**2)).mean()  # Geman and McClure's: an outlier pulls no further
            bends = poses.diff(n=2, dim=1).square().mean() if poses.shape[1] > 2 else near * 0
            return _PRIOR * (error.mean() + _DIVERGENCE * divergence.mean()) + _NEAR * near + _SMOOTH * bends

        (moved,) = descended([torch.zeros_like(gaps.base)], unusual, steps=_STEPS, rate=_RATE)
        return gaps.base + gate * moved


def _layers(inputs: int, outputs: int, sizes: MethodSizes) -> nn.Sequential:
    """Linear layers with a GELU and a norm between them."""
    parts: list[nn.Module] = []
    for _ in range(sizes.layers):
        parts += [nn.Linear(inputs, sizes.width), nn.LayerNorm(sizes.width), nn.GELU()]
        inputs = sizes.width
    return nn.Sequential(*parts, nn.Linear(inputs, outputs))
