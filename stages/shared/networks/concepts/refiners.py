"""The networks of refinement (motion concepts 3.2): anchor recogniser, anchor refiner, transition refiner.

Sequences are (B, T, 3 J) metres on the standard body, the pelvis of the first frame at the origin, facing +Z there.
Where the paper is silent: masked frames are hidden from attention; the logits of concepts of other actions are set to
minus infinity; the concept feature of a transition is the mean over its frames, which attend only to each other; the
bias feature is the mean over all frames; and the refined sequence is added to the restored splines.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from stages.shared.networks.concepts.motion_encoder import MotionEncoder, perceptron, sinusoidal
from stages.shared.networks.concepts.transition_generator import (
    OUTPUT_M,
    POWERS,
    WAVES,
    TransitionGenerator,
    at_times,
    straight,
    waves,
)


class AnchorRecogniser(nn.Module):
    """Which frames are anchors: features (B, T, D) and logits (B, T)."""

    def __init__(self, features: int, actions: int, width: int):
        super().__init__()
        self.encoder = MotionEncoder(features, actions, width)
        self.classifier = perceptron(width, 1)

    def forward(self, motion: Tensor, action: Tensor, seen: Tensor) -> tuple[Tensor, Tensor]:
        found = self.encoder(motion, action, seen)
        return found, self.classifier(found).squeeze(-1)


class AnchorRefiner(nn.Module):
    """A new anchor in the place of a flawed one, from the rest of the sequence and the concept that fits there.

    Args:
        concepts: (C, F) the anchor concepts of all actions; action_of: (C,) the action of each.
    """

    concepts: Tensor
    action_of: Tensor

    def __init__(self, features: int, actions: int, width: int, concepts: Tensor, action_of: Tensor):
        super().__init__()
        self.encoder = MotionEncoder(features, actions, width)
        self.classifier = perceptron(width, len(concepts))
        self.embed = nn.Linear(features, width)
        self.decoder = perceptron(2 * width, features, 2 * width)
        self.register_buffer("concepts", concepts)
        self.register_buffer("action_of", action_of)

    def forward(
        self, motion: Tensor, action: Tensor, seen: Tensor, at: Tensor, concept: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Logits (B, C) of the concepts at the frames `at` (B,), and new anchors (B, F).

        Args:
            seen: (B, T) False for the masked frames. concept: (B,) the true ones; None takes the likeliest.
        """
        features = self.encoder(motion, action, seen)[torch.arange(len(at), device=at.device), at]
        logits = self.classifier(features).masked_fill(self.action_of[None] != action[:, None], float("-inf"))
        chosen = logits.argmax(-1) if concept is None else concept
        return logits, self.decoder(torch.cat([features, self.embed(self.concepts[chosen])], dim=-1))


class Segments(NamedTuple):
    """The transitions of padded sequences, S at most in each.

    of_frame: (B, T) index of each frame's transition. times: (B, T) from 0 to 1 in it.
    first, last: (B, S) frames of its anchors; unused ones are 0.
    """

    of_frame: Tensor
    times: Tensor
    first: Tensor
    last: Tensor


class TransitionRefiner(nn.Module):
    """Makes a sequence from the concept of each of its transitions and one bias feature of the whole.

    Args:
        splines: whether a concept is decoded to a cubic, or to the pose at each moment (Table 9).
    """

    def __init__(self, features: int, actions: int, width: int, *, splines: bool = True):
        super().__init__()
        self.splines = splines
        self.concept_encoder = MotionEncoder(features, actions, width)
        self.bias_encoder = MotionEncoder(features, actions, width)
        self.spline = perceptron(width, POWERS * features) if splines else perceptron(width + WAVES, features)
        self.transformer = MotionEncoder(2 * width, actions, width)
        self.output = nn.Linear(width, features)
        nn.init.zeros_(self.output.weight)
        nn.init.zeros_(self.output.bias)

    def forward(self, motion: Tensor, action: Tensor, valid: Tensor, segments: Segments) -> tuple[Tensor, Tensor]:
        """The refined sequence (B, T, F), and the sequence of the concepts alone (B, T, F)."""
        count = segments.first.shape[1]
        member = nn.functional.one_hot(segments.of_frame, count).to(motion.dtype) * valid[..., None]  # (B, T, S)
        together = (member @ member.transpose(1, 2) > 0) | torch.eye(
            motion.shape[1], dtype=torch.bool, device=motion.device
        )
        frames = self.concept_encoder(motion, action, valid, together)
        share = member / member.sum(1, keepdim=True).clamp_min(1)
        concepts = share.transpose(1, 2) @ frames  # (B, S, D)
        rows = torch.arange(len(motion), device=motion.device)[:, None]
        lines = straight(motion[rows, segments.first], motion[rows, segments.last])
        of_frame = rows, segments.of_frame
        restored = at_times(lines[of_frame], segments.times[..., None]).squeeze(2)
        if self.splines:
            splines = OUTPUT_M * self.spline(concepts).unflatten(-1, (POWERS, -1))  # (B, S, 4, F)
            restored = restored + at_times(splines[of_frame], segments.times[..., None]).squeeze(2)
        else:
            moments = torch.cat([concepts[of_frame], waves(segments.times)], dim=-1)
            restored = restored + OUTPUT_M * self.spline(moments)
        weight = valid[..., None].to(motion.dtype)
        bias = (self.bias_encoder(motion, action, valid) * weight).sum(1) / weight.sum(1)
        whole = torch.cat([concepts[rows, segments.of_frame], bias[:, None].expand(-1, motion.shape[1], -1)], dim=-1)
        whole = whole + sinusoidal(motion.shape[1], whole.shape[-1], motion.device)
        return restored + self.output(self.transformer(whole, action, valid)), restored


class ConceptNetworks(nn.Module):
    """The four networks. They share no parameter; only the clipping of gradients and the choice of the best step
    depend on all of them.

    Args:
        features: 3 J. width: of the motion encoders. latent: of the generator's code.
        concepts: (C, F) the anchor concepts of all actions; action_of: (C,) the action of each.
        splines: whether transitions are cubics, or poses that a network fits directly (Table 9).
    """

    def __init__(
        self,
        features: int,
        actions: int,
        width: int,
        latent: int,
        concepts: Tensor,
        action_of: Tensor,
        *,
        splines: bool = True,
    ):
        super().__init__()
        self.generator = TransitionGenerator(features, latent, splines=splines)
        self.recogniser = AnchorRecogniser(features, actions, width)
        self.anchors = AnchorRefiner(features, actions, width, concepts, action_of)
        self.transitions = TransitionRefiner(features, actions, width, splines=splines)
