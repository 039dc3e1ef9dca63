"""The losses of motion concepts: equation 3 (generator), 4 (recogniser), 3.2.2 (anchors) and 5 (transitions)."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from stages.shared.concepts.sequences import ConceptSet
from stages.shared.networks.concepts.refiners import ConceptNetworks
from stages.shared.networks.concepts.transition_generator import at_times, joint_distance
from stages.shared.networks.layers.row_generator import RowGenerator, draw_normal
from stages.shared.training.task import HELD_BACK_SEED, TrainingTask, step_random
from stages.train.concepts.config import Config
from stages.train.concepts.drawing import ConceptBatch, ConceptDrawer

_VALIDATION_WINDOWS = 64
_VALIDATION = 21  # the purpose of the generator


class ConceptTask(TrainingTask[ConceptNetworks]):
    """The four networks, each with its own loss. Their sum is minimised; they share no parameter."""

    def __init__(self, config: Config, networks: ConceptNetworks, found: ConceptSet, device: torch.device):
        self.config, self.networks, self.device = config, networks.to(device), device
        self._drawer = ConceptDrawer(found, found.of("train"), config.window)
        held_back = ConceptDrawer(found, found.of("val") or found.of("train"), config.window)
        rows = range(_VALIDATION_WINDOWS)
        self.held_back = held_back.draw(step_random(HELD_BACK_SEED, _VALIDATION, 0, rows))

    def drawer(self, *, elsewhere: bool = False) -> ConceptDrawer:
        return self._drawer

    def loss(self, batch: ConceptBatch, generator: RowGenerator) -> tuple[Tensor, dict[str, Tensor]]:
        batch = batch.to(self.device)
        noise = draw_normal((len(batch.motion), self.config.latent), generator, self.device)
        terms = {**self._generator(batch, noise), **self._refiners(batch)}
        config = self.config
        weights = {"anchor": config.anchor_weight, "kl": config.kl_weight, "spline": config.spline_weight}
        value = torch.stack([weights.get(name, 1.0) * term for name, term in terms.items()]).sum()
        return value, {name: term.detach() for name, term in terms.items()}

    def _generator(self, batch: ConceptBatch, noise: Tensor) -> dict[str, Tensor]:
        """Equation 3: transition, last anchor and KL divergence."""
        made = self.networks.generator(batch.start, batch.end, batch.seconds, batch.between, batch.counts, noise)
        steps = torch.arange(batch.between.shape[1], device=self.device)
        times = (steps / (batch.counts[:, None] - 1).clamp_min(1)).clamp(max=1.0)
        real = (steps < batch.counts[:, None]).float()
        apart = joint_distance(at_times(made.splines, times), batch.between)
        last = joint_distance(made.splines.sum(1), batch.end)
        divergence = 0.5 * (made.mean.square() + made.log_variance.exp() - 1 - made.log_variance).sum(1)
        return {"transition": (apart * real).sum() / real.sum(), "anchor": last.mean(), "kl": divergence.mean()}

    def _refiners(self, batch: ConceptBatch) -> dict[str, Tensor]:
        """Equations 4 and 5, and cross entropy and MPJPE of masked anchors."""
        valid = batch.valid.float()
        _, logits = self.networks.recogniser(batch.motion, batch.action, batch.valid)
        found = F.binary_cross_entropy_with_logits(logits, batch.anchors.float(), reduction="none")
        known = batch.concept >= 0
        classes, poses = self.networks.anchors(
            batch.motion, batch.action, batch.seen, batch.at, torch.where(known, batch.concept, self._any(batch))
        )
        true = batch.motion[torch.arange(len(batch.at), device=self.device), batch.at]
        entropy = F.cross_entropy(classes[known], batch.concept[known]) if known.any() else poses.sum() * 0
        whole, restored = self.networks.transitions(batch.motion, batch.action, batch.valid, batch.segments)
        return {
            "recogniser": (found * valid).sum() / valid.sum(),
            "concept": entropy,
            "pose": joint_distance(poses, true).mean(),
            "sequence": (joint_distance(whole, batch.motion) * valid).sum() / valid.sum(),
            "spline": (joint_distance(restored, batch.restored) * valid).sum() / valid.sum(),
        }

    def _any(self, batch: ConceptBatch) -> Tensor:
        """A concept of each row's action, for the first and last frame of a window, which need not be anchors."""
        own = self.networks.anchors.action_of[None] == batch.action[:, None]
        return own.float().argmax(1)

    def validate(self) -> dict[str, float]:
        """Errors of all four on held-back windows, with codes of zero; the first is their sum without the KL
        divergence."""
        batch = self.held_back.to(self.device)
        noise = torch.zeros(len(batch.motion), self.config.latent, device=self.device)
        terms = {**self._generator(batch, noise), **self._refiners(batch)}
        _, logits = self.networks.recogniser(batch.motion, batch.action, batch.valid)
        hits = ((logits > 0) & batch.anchors & batch.valid).sum()
        f1 = 2 * hits / ((logits > 0) & batch.valid).sum().add((batch.anchors & batch.valid).sum()).clamp_min(1)
        figures = {name: float(term) for name, term in terms.items()}
        whole = sum(value for name, value in figures.items() if name != "kl")
        return {"sum": whole, **figures, "anchor_f1": float(f1)}
