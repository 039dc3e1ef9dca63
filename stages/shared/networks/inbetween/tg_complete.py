"""TG_complete: a recurrent transition network with a target (Harvey et al., Robust Motion In-Betweening, 2020).

Frame by frame, an LSTM reads the encoded last pose, the offset to the next key and that key, each with an embedding
of the time to arrival; its output is the step to the next pose. Scheduled noise on the encoded target keeps long
gaps varied (their section 4.2). Left out: the two critics and foot contacts. A chain of gaps is one recurrence, in
which known poses take the place of predicted ones.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from stages.shared.networks.inbetween.method import Gaps, Method, Paper
from stages.shared.networks.inbetween.pose_space import PoseSpace
from stages.shared.networks.layers.attention import clear_linear, sinusoids
from stages.shared.networks.layers.sizes import MethodSizes
from stages.shared.networks.pumps.synthesiser import neighbouring_keys

_TARGET_NOISE = 0.5  # deviation, their section 4.2
_NO_NOISE, _FULL_NOISE = 5, 30  # frames to arrival


class TgComplete(Method):
    """Three encoders, an LSTM and a decoder of steps."""

    PAPER = Paper(
        MethodSizes(width=512, layers=1, heads=1),
        learning_rate=1e-3,
        batch=32,
        source="Harvey et al. 2020, sections 4 and 5: encoders 512 and 256, LSTM 1024, AMSGrad at 1e-3",
    )

    def __init__(self, space: PoseSpace, sizes: MethodSizes):
        super().__init__(space, sizes)
        width, half = sizes.width, max(2, sizes.width // 4 * 2)
        self.narrow = half

        def encoder() -> nn.Sequential:
            return nn.Sequential(nn.Linear(space.width, width), nn.PReLU(), nn.Linear(width, half), nn.PReLU())

        self.state, self.offset, self.target = encoder(), encoder(), encoder()
        self.memory = nn.LSTMCell(3 * half, 2 * width)
        self.begin = nn.Linear(half, 2 * width)
        self.out = nn.Sequential(
            nn.Linear(2 * width, width), nn.PReLU(), nn.Linear(width, half), nn.PReLU(), nn.Linear(half, space.width)
        )
        clear_linear(self.out[-1])  # until it is trained, poses stay as they are

    def fill(self, gaps: Gaps) -> Tensor:
        return self._unrolled(gaps, None)

    def fit(self, gaps: Gaps, truth: Tensor, generator: torch.Generator) -> tuple[Tensor, dict[str, Tensor]]:
        return self.pose_loss(gaps, self._unrolled(gaps, generator), truth), {}

    def _unrolled(self, gaps: Gaps, generator: torch.Generator | None) -> Tensor:
        count = len(gaps.poses)
        first, after = neighbouring_keys(gaps.known)
        pose = gaps.poses.gather(1, first[:, :1].unsqueeze(-1).expand(-1, 1, self.space.width)).squeeze(1)
        made = [torch.where(gaps.known[:, :1], gaps.poses[:, 0], pose)]
        hidden = self.begin(self.state(pose)).tanh()
        cell = torch.zeros_like(hidden)
        goals = gaps.poses.gather(1, after.unsqueeze(-1).expand_as(gaps.poses))
        left = (after - gaps.times).clamp_min(0)
        arrivals = sinusoids(left, self.narrow)
        targets = self.target(goals) + arrivals
        noise = torch.zeros(count, 2 * self.narrow, device=pose.device)
        if generator is not None:
            noise = _TARGET_NOISE * torch.randn(noise.shape, generator=generator, device=pose.device)
        blurred = ((left - _NO_NOISE) / (_FULL_NOISE - _NO_NOISE)).clamp(0, 1).unsqueeze(-1)
        for frame in range(1, gaps.poses.shape[1]):
            arrival = arrivals[:, frame]
            wanted = torch.cat([self.offset(goals[:, frame] - pose) + arrival, targets[:, frame]], dim=-1)
            inputs = torch.cat([self.state(pose) + arrival, wanted + blurred[:, frame] * noise], dim=-1)
            hidden, cell = self.memory(inputs, (hidden, cell))
            pose = torch.where(gaps.known[:, frame : frame + 1], gaps.poses[:, frame], pose + self.out(hidden))
            made.append(pose)
        return torch.stack(made, dim=1)
