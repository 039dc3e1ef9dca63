"""The action recogniser whose features measure generated motions: a GRU over the frames (as Guo et al. 2020 have it).

Two layers of 128, the state after the last frame, a feature of 30 numbers, and one logit an action.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn


class ActionRecogniser(nn.Module):
    """Sequences (B, T, F) to features (B, D) and logits (B, actions)."""

    def __init__(self, features: int, actions: int, width: int = 128, layers: int = 2, feature: int = 30):
        super().__init__()
        self.recurrent = nn.GRU(features, width, layers, batch_first=True)
        self.feature = nn.Linear(width, feature)
        self.classifier = nn.Linear(feature, actions)

    def forward(self, motion: Tensor, counts: Tensor) -> tuple[Tensor, Tensor]:
        """counts: (B,) real frames of each sequence, at least 1; what follows them is not read."""
        states, _ = self.recurrent(motion)
        last = states[torch.arange(len(motion), device=motion.device), counts - 1]
        found = self.feature(last).tanh()
        return found, self.classifier(found)
