"""Pose-NDF: a learned distance to the poses that occur, descended at test time (Tiwari et al., ECCV 2022).

A network learns the distance of any pose to the nearest pose of the training data. A gap's frames start from the
plain interpolation and are moved down the distance, held near their start and smooth over time. The distance is that
of the paper's equation 2 without its weights, to the nearest of the batch's poses instead of the whole data set's.
It knows nothing of time and of the root, which stays that of the plain interpolation.
"""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn

from stages.shared.kinematics.rotations import continuous_signs, from_turn_vectors, multiply, shorter_way
from stages.shared.networks.inbetween.descent import descended
from stages.shared.networks.inbetween.method import Gaps, Method, Paper
from stages.shared.networks.inbetween.pose_space import PoseSpace
from stages.shared.networks.layers.sizes import MethodSizes

_NOISE_RAD = (0.02, 0.05, 0.1, 0.25, 0.5)  # deviations of the turns that make poses which do not occur
_QUERIES, _BANK = 256, 1024  # poses a step: that are judged, and among which the nearest is searched
_DESCENT, _RATE = 30, 0.01  # steps and rate of the descent
_PRIOR, _NEAR, _SMOOTH = 1.0, 5.0, 10.0  # weights at test time
_NOISY_STEPS, _NOISY_NEAR, _NOISY_SMOOTH = 40, 0.3, 3.0  # the same for noisy motions, whose roots are smoothed too
_ROOT_STANDARD = 3.0  # of a standardised root's acceleration, against that of a quaternion


class PoseNdf(Method):
    """An encoder for each joint, which also reads its parent's code, and a network from all codes to a distance."""

    descends = True
    PAPER = Paper(
        MethodSizes(width=512, layers=5, heads=6),
        learning_rate=1e-4,
        batch=64,
        source="Tiwari et al. 2022, section 4: codes of 6 numbers a joint, five layers of 512, Adam at 1e-4",
    )

    def __init__(self, space: PoseSpace, sizes: MethodSizes):
        super().__init__(space, sizes)
        code, bones = sizes.heads, space.bones - 1  # the root's own rotation is free
        self.encoders = nn.ModuleList(
            nn.Sequential(nn.Linear(4 + code, 4 * code), nn.Softplus(beta=100), nn.Linear(4 * code, code))
            for _ in range(bones)
        )
        widths = [code * bones, *[sizes.width] * (sizes.layers - 1), 1]
        parts: list[nn.Module] = []
        for before, after in pairwise(widths):
            parts += [nn.Linear(before, after), nn.Softplus(beta=100)]
        self.judge = nn.Sequential(*parts)

    def distance(self, local: Tensor) -> Tensor:
        """(N,) the learned distance of poses, local rotations (N, J, 4)."""
        local = shorter_way(local)
        codes: list[Tensor] = [local.new_zeros(len(local), self.sizes.heads)]
        for bone, encoder in enumerate(self.encoders, start=1):
            above = codes[int(self.space.parents[bone])]
            codes.append(encoder(torch.cat([local[:, bone], above], dim=-1)))
        return self.judge(torch.cat(codes[1:], dim=-1)).squeeze(-1)

    def fit(self, gaps: Gaps, truth: Tensor, generator: torch.Generator) -> tuple[Tensor, dict[str, Tensor]]:
        """The mean square of the error of distances: of poses that occur (0), and of the same with noise."""
        bank = self.space.local(truth[gaps.valid])
        order = torch.randperm(len(bank), generator=generator, device=bank.device)
        bank = bank[order[:_BANK]]
        real = bank[:_QUERIES]
        kinds = torch.randint(len(_NOISE_RAD), (len(real), 1, 1), generator=generator, device=bank.device)
        size = torch.tensor(_NOISE_RAD, device=bank.device)[kinds]
        noise = size * torch.randn((*real.shape[:-1], 3), generator=generator, device=bank.device)
        noisy = multiply(real, from_turn_vectors(noise))
        away = self.distance(noisy) - nearest_distance(noisy, bank)
        at_home = self.distance(real)
        return away.square().mean() + at_home.square().mean(), {"at_home": at_home.abs().mean()}

    def fill(self, gaps: Gaps) -> Tensor:
        start = self.space.local(gaps.base)
        gate = gaps.missing[..., None, None].to(start.dtype)

        def unusual(turns: Tensor) -> Tensor:
            moved = multiply(start, from_turn_vectors(turns * gate))
            prior = self.distance(moved.flatten(0, 1)).square().mean()
            bends = (turns * gate).diff(n=2, dim=1) if turns.shape[1] > 2 else turns
            return _PRIOR * prior + _NEAR * (turns * gate).square().mean() + _SMOOTH * bends.square().mean()

        (turns,) = descended([_no_turns(start)], unusual, steps=_DESCENT, rate=_RATE)
        return self.space.with_local(gaps.base, multiply(start, from_turn_vectors(turns * gate)))

    def denoise(self, gaps: Gaps) -> Tensor:
        """Gradient descent lowers the learned distance, starting from the noisy poses. A robust distance keeps the
        result near them, and second differences keep the rotations and the root's path smooth; the network does not
        see the root."""
        start, roots = continuous_signs(self.space.local(gaps.base), axis=1), gaps.base[..., :3]

        def unusual(turns: Tensor, shift: Tensor) -> Tensor:
            moved = multiply(start, from_turn_vectors(turns))
            prior = self.distance(moved.flatten(0, 1)).square().mean()
            near = (turns.square().sum(-1) + 1e-6).sqrt().mean() + (shift.square().sum(-1) + 1e-6).sqrt().mean()
            bends = moved.diff(n=2, dim=1).square().sum(-1).mean() if moved.shape[1] > 2 else 0 * near
            path = (roots + shift).diff(n=2, dim=1).square().mean() if moved.shape[1] > 2 else 0 * near
            return _PRIOR * prior + _NOISY_NEAR * near + _NOISY_SMOOTH * (bends + _ROOT_STANDARD * path)

        turns, shift = descended([_no_turns(start), torch.zeros_like(roots)], unusual, steps=_NOISY_STEPS, rate=_RATE)
        made = self.space.with_local(gaps.base, multiply(start, from_turn_vectors(turns)))
        return torch.cat([roots + shift, made[..., 3:]], dim=-1)


def _no_turns(local: Tensor) -> Tensor:
    """(..., 3) turn vectors of zero for rotations (..., 4)."""
    return torch.zeros(*local.shape[:-1], 3, device=local.device)


def nearest_distance(poses: Tensor, bank: Tensor) -> Tensor:
    """(N,) each pose's distance to the nearest of the bank: root of the sum over joints of squared angles, radians,
    without the root joint. poses (N, J, 4), bank (M, J, 4)."""
    with torch.autocast(poses.device.type, enabled=False):  # an angle near 0 needs all digits of its cosine
        cosines = torch.einsum("njc,mjc->nmj", poses[:, 1:].float(), bank[:, 1:].float()).abs().clamp(max=1.0)
    return (2 * torch.arccos(cosines)).square().sum(-1).amin(1).sqrt()
