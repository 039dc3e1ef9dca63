"""The motion encoder of motion concepts (3.2.1, figure 3-a-2): a feature of every frame of a sequence.

Frames are embedded linearly and added to sinusoidal positions; transformer blocks encode them; decoder blocks, whose
queries are the positions alone, read a feature for every frame from the encoded ones. An embedding of the action is
added to the frames: the paper learns its modules action by action, which needs much data of each; here all actions
share one network.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn


def sinusoidal(frames: int, width: int, device: torch.device) -> Tensor:
    """(T, D) positional encodings: sines in even and cosines in odd columns, wavelengths 2 pi to 20000 pi."""
    times = torch.arange(frames, device=device, dtype=torch.float32)[:, None]
    rates = torch.exp(torch.arange(0, width, 2, device=device) * (-torch.log(torch.tensor(10000.0)).item() / width))
    return torch.stack([(times * rates).sin(), (times * rates).cos()], dim=-1).flatten(1)


def perceptron(inputs: int, outputs: int, hidden: int = 128) -> nn.Sequential:
    """The paper's three-layer MLP."""
    return nn.Sequential(
        nn.Linear(inputs, hidden), nn.ReLU(), nn.Linear(hidden, hidden), nn.ReLU(), nn.Linear(hidden, outputs)
    )


class MotionEncoder(nn.Module):
    """Sequences of features (B, T, F) to a feature of every frame (B, T, D).

    Args:
        features: F. actions: number of actions. width: D. heads, blocks, hidden: of the transformer; the defaults are
            appendix A's.
    """

    def __init__(
        self, features: int, actions: int, width: int = 128, heads: int = 4, blocks: int = 2, hidden: int = 128
    ):
        super().__init__()
        self.width, self.heads = width, heads
        self.embed = nn.Linear(features, width)
        self.action = nn.Embedding(max(actions, 1), width)
        layer = {"d_model": width, "nhead": heads, "dim_feedforward": hidden, "dropout": 0.0, "batch_first": True}
        self.encoder = nn.TransformerEncoder(nn.TransformerEncoderLayer(**layer), blocks, enable_nested_tensor=False)
        self.decoder = nn.TransformerDecoder(nn.TransformerDecoderLayer(**layer), blocks)

    def forward(self, features: Tensor, action: Tensor, seen: Tensor, together: Tensor | None = None) -> Tensor:
        """Features of all frames.

        Args:
            features: (B, T, F). action: (B,) index. seen: (B, T) True for frames that may be attended, at least one.
            together: (B, T, T) True where two frames may attend each other, instead of `seen`; None to use `seen`.
        """
        places = sinusoidal(features.shape[1], self.width, features.device)
        hidden = ~seen
        mask = None if together is None else (~together).repeat_interleave(self.heads, dim=0)
        embedded = self.embed(features) + places + self.action(action)[:, None]
        encoded = self.encoder(embedded, mask=mask, src_key_padding_mask=None if mask is not None else hidden)
        queries = places.expand(len(features), -1, -1)
        return self.decoder(
            queries, encoded, tgt_mask=mask, memory_mask=mask,
            memory_key_padding_mask=None if mask is not None else hidden,
        )  # fmt: skip
