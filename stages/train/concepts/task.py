"""The losses of motion concepts: equation 3 (generator), 4 (recogniser), 3.2.2 (anchors) and 5 (transitions)."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from stages.shared.concepts.sequences import ConceptSet
from stages.shared.networks.concepts.reconstruction import MotionReconstructor
from stages.shared.networks.concepts.refiners import ConceptNetworks
from stages.shared.networks.concepts.transition_generator import joint_distance
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
        self._drawer, self.held_back = _batches(config, found)

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
        frames = self.networks.generator.decoded(batch.start, batch.end, batch.seconds, made.code, times)
        apart = joint_distance(frames, batch.between)
        last = joint_distance(frames[:, -1], batch.end)  # times of padded frames are 1
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
        # Concepts that are fitted directly learn the motion itself, with what is one person's own in it.
        fitted = batch.restored if self.networks.transitions.splines else batch.motion
        whole, restored = self.networks.transitions(batch.motion, batch.action, batch.valid, batch.segments)
        return {
            "recogniser": (found * valid).sum() / valid.sum(),
            "concept": entropy,
            "pose": joint_distance(poses, true).mean(),
            "sequence": (joint_distance(whole, batch.motion) * valid).sum() / valid.sum(),
            "spline": (joint_distance(restored, fitted) * valid).sum() / valid.sum(),
        }

    def _any(self, batch: ConceptBatch) -> Tensor:
        """A concept of each row's action, for the first and last frame of a window, which need not be anchors."""
        own = self.networks.anchors.action_of[None] == batch.action[:, None]
        return own.float().argmax(1)

    def validate(self) -> dict[str, float]:
        """Errors of all four on held-back windows, with codes of zero; the first is their sum without the KL
        divergence. `anchor_f1` takes as many frames of the highest chance as there are anchors, the ends of windows,
        which always are anchors, left out."""
        batch = self.held_back.to(self.device)
        noise = torch.zeros(len(batch.motion), self.config.latent, device=self.device)
        terms = {**self._generator(batch, noise), **self._refiners(batch)}
        _, logits = self.networks.recogniser(batch.motion, batch.action, batch.valid)
        inner = batch.valid.clone()
        inner[:, 0] = False
        inner[torch.arange(len(inner), device=self.device), batch.valid.sum(1) - 1] = False
        true = batch.anchors[inner]
        likeliest = logits[inner].topk(int(true.sum())).indices
        f1 = true[likeliest].float().mean() if len(likeliest) else true.float().sum()
        figures = {name: float(term) for name, term in terms.items()}
        whole = sum(value for name, value in figures.items() if name != "kl")
        return {"sum": whole, **figures, "anchor_f1": float(f1)}


class ReconstructionTask(TrainingTask[MotionReconstructor]):
    """A network that returns the motion it is given (Table 10)."""

    def __init__(self, config: Config, networks: MotionReconstructor, found: ConceptSet, device: torch.device):
        self.networks, self.device = networks.to(device), device
        self._drawer, self.held_back = _batches(config, found)

    def drawer(self, *, elsewhere: bool = False) -> ConceptDrawer:
        return self._drawer

    def loss(self, batch: ConceptBatch, generator: RowGenerator) -> tuple[Tensor, dict[str, Tensor]]:
        return self._error(batch.to(self.device)), {}

    def validate(self) -> dict[str, float]:
        """The error of the sequence on held-back windows, metres."""
        return {"sequence": float(self._error(self.held_back.to(self.device)))}

    def _error(self, batch: ConceptBatch) -> Tensor:
        valid = batch.valid.float()
        apart = joint_distance(self.networks(batch.motion, batch.action, batch.valid), batch.motion)
        return (apart * valid).sum() / valid.sum()


def _batches(config: Config, found: ConceptSet) -> tuple[ConceptDrawer, ConceptBatch]:
    """What draws training windows, and the held-back ones."""
    held_back = ConceptDrawer(found, found.of("val") or found.of("train"), config.window)
    rows = range(_VALIDATION_WINDOWS)
    return (
        ConceptDrawer(found, found.of("train"), config.window),
        held_back.draw(step_random(HELD_BACK_SEED, _VALIDATION, 0, rows)),
    )
