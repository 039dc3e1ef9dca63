"""Motions reconstructed as a whole, without concepts: what the paper compares its refinement with (Table 10)."""

from __future__ import annotations

from torch import Tensor, nn

from stages.shared.networks.concepts.motion_encoder import MotionEncoder


class MotionReconstructor(nn.Module):
    """A motion encoder, and a transformer of the same structure that decodes its features to the motion.

    Args:
        features: F = 3 J. actions: number of actions. width: of the encoders, a multiple of 4.
    """

    def __init__(self, features: int, actions: int, width: int):
        super().__init__()
        self.encoder = MotionEncoder(features, actions, width)
        self.transformer = MotionEncoder(width, actions, width)
        self.output = nn.Linear(width, features)

    def forward(self, motion: Tensor, action: Tensor, valid: Tensor) -> Tensor:
        """Motions (B, T, F) metres, of motions (B, T, F) placed by their first frames.

        Args:
            action: (B,) index. valid: (B, T) True for frames of the motion, False for padding.
        """
        return self.output(self.transformer(self.encoder(motion, action, valid), action, valid))
