"""siMLPe: joints to come from joints that were, by fully connected layers (SpecTrHuMS' reference 6), to compare with.

Positions are transformed by the discrete cosine transform over time; one layer mixes coordinates, blocks mix
frequencies, one more layer mixes coordinates; the inverse transform gives differences from the last known frame.
"""

from __future__ import annotations

import numpy as np
import torch
from scipy.fft import dct
from torch import Tensor, nn

from stages.shared.networks.layers.sizes import JointMlpSizes


class _Block(nn.Module):
    """x + norm(time layer(x)): (B, C, T), the norm over coordinates."""

    def __init__(self, frames: int, width: int):
        super().__init__()
        self.time, self.norm = nn.Linear(frames, frames), nn.LayerNorm(width)
        nn.init.xavier_uniform_(self.time.weight, gain=1e-8)
        nn.init.zeros_(self.time.bias)

    def forward(self, values: Tensor) -> Tensor:
        return values + self.norm(self.time(values).transpose(1, 2)).transpose(1, 2)


class JointMlp(nn.Module):
    """Known joints (B, known, K, 3) metres to the next `ahead` ones (B, ahead, K, 3).

    Args:
        joints: K. known, ahead: frames; ahead is at most known.
    """

    transform: Tensor

    def __init__(self, joints: int, known: int, ahead: int, sizes: JointMlpSizes):
        super().__init__()
        if ahead > known:
            raise ValueError(f"siMLPe predicts as many frames as it sees ({known}) at most, not {ahead}")
        self.joints, self.known, self.ahead = joints, known, ahead
        width = 3 * joints
        matrix = torch.from_numpy(np.asarray(dct(np.eye(known), axis=0, norm="ortho"), np.float32))
        self.register_buffer("transform", matrix)
        self.into, self.out = nn.Linear(width, width), nn.Linear(width, width)
        self.blocks = nn.Sequential(*(_Block(known, width) for _ in range(sizes.blocks)))
        # The paper's start: the last known pose is repeated.
        nn.init.xavier_uniform_(self.out.weight, gain=1e-8)
        nn.init.zeros_(self.out.bias)

    def forward(self, joints: Tensor) -> Tensor:
        flat = joints.flatten(2)
        mixed = self.into(self.transform @ flat).transpose(1, 2)
        made = self.transform.T @ self.out(self.blocks(mixed).transpose(1, 2))
        return (flat[:, -1:] + made[:, : self.ahead]).reshape(len(joints), self.ahead, self.joints, 3)

    def loss(self, made: Tensor, true: Tensor) -> Tensor:
        """Mean error of positions and of velocities, metres and metres a frame."""
        speed = (made.diff(dim=1) - true.diff(dim=1)).norm(dim=-1).mean()
        return (made - true).norm(dim=-1).mean() + speed
