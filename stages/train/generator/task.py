"""The loss of generators of motions by action: squared error of standardised frames, and the codes' divergence."""

from __future__ import annotations

import torch
from torch import Tensor

from stages.shared.concepts.sequences import ConceptSet
from stages.shared.networks.concepts.action_generators import LEAST_SPREAD_M, ActionGenerator, relative_frames
from stages.shared.networks.concepts.transition_generator import joint_distance
from stages.shared.networks.layers.row_generator import RowGenerator, draw_normal
from stages.shared.training.action_windows import ActionBatch, ActionDrawer, windows_of
from stages.shared.training.task import HELD_BACK_SEED, TrainingTask, step_random
from stages.train.generator.config import Config

_VALIDATION_WINDOWS = 64
_VALIDATION = 22  # the purpose of the generator


class GeneratorTask(TrainingTask[ActionGenerator]):
    """Training on clips of the split `train`; validation on windows of `val`, or of `train` where there is none."""

    def __init__(self, config: Config, network: ActionGenerator, found: ConceptSet, device: torch.device):
        self.config, self.device = config, device
        self._drawer = ActionDrawer(found, config.window)
        _standardise(network, self._drawer.batch(windows_of(found.of("train"), config.window)))
        self.networks = network.to(device)
        rows = range(_VALIDATION_WINDOWS)
        random = step_random(HELD_BACK_SEED, _VALIDATION, 0, rows)
        held_back = found.of("val") or found.of("train")
        self.held_back = ActionDrawer(found, config.window, held_back).draw(random)
        self.noise = torch.randn(
            self.networks.noise_shape(len(rows), config.window), generator=torch.Generator().manual_seed(0)
        ).to(device)

    def drawer(self, *, elsewhere: bool = False) -> ActionDrawer:
        return self._drawer

    def loss(self, batch: ActionBatch, generator: RowGenerator) -> tuple[Tensor, dict[str, Tensor]]:
        shape = self.networks.noise_shape(len(batch.motion), batch.motion.shape[1])
        error, divergence, _ = self._errors(batch, draw_normal(shape, generator, self.device))
        value = error + self.config.kl_weight * divergence
        return value, {"error": error.detach(), "kl": divergence.detach()}

    def validate(self) -> dict[str, float]:
        """The loss on held-back windows, its parts, and the mean distance of the joints in mm, with fixed noise."""
        error, divergence, apart = self._errors(self.held_back, self.noise)
        value = float(error + self.config.kl_weight * divergence)
        return {"loss": value, "error": float(error), "kl": float(divergence), "mpjpe_mm": 1000 * float(apart)}

    def _errors(self, batch: ActionBatch, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        motion, action = batch.motion.to(self.device), batch.action.to(self.device)
        valid = torch.arange(motion.shape[1], device=self.device) < batch.counts.to(self.device)[:, None]
        made = self.networks(motion, action, valid, noise)
        real = valid.to(motion.dtype)
        errors = (made.frames - self.networks.standardised(motion)).square().mean(-1)
        apart = joint_distance(self.networks.positions(made.frames.detach()), motion)
        return (errors * real).sum() / real.sum(), made.divergence.mean(), (apart * real).sum() / real.sum()


def _standardise(network: ActionGenerator, batch: ActionBatch) -> None:
    """Set the mean and the spread of frames in a network, from windows."""
    valid = torch.arange(batch.motion.shape[1]) < batch.counts[:, None]
    frames = relative_frames(batch.motion)[valid]
    network.mean.copy_(frames.mean(0))
    network.spread.copy_(frames.std(0).clamp_min(LEAST_SPREAD_M))
