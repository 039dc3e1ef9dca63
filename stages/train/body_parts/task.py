"""Training the autoencoders of body parts: windows of rotations, the loss of each part, validation.

The parts share the windows of a step and nothing else: no weight, no gradient and no random number of one depends on
the others, so that a part trained alone has the same weights after as many steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from stages.shared.humanoid.body_parts import BodyPart, body_part
from stages.shared.humanoid.clips_on_rig import RigBodyJoints, RotationClip
from stages.shared.humanoid.decompositions import PART_NAMES
from stages.shared.kinematics.matrix_poses import columns_of
from stages.shared.networks.body_parts.losses import reconstruction_terms, weighted_sum
from stages.shared.networks.body_parts.part_networks import NETWORKS, PartNetwork
from stages.shared.training.task import HELD_BACK_SEED, RowRandom, TrainingTask, step_random
from stages.train.body_parts.config import Config

_VALIDATION, _MEAN = 13, 14  # the purposes of the generators
_VALIDATION_WINDOWS, _MEAN_WINDOWS = 64, 256
_RISING = 0.5  # share of a cycle in which the divergence's weight rises (Fu et al. 2019)


@dataclass(frozen=True)
class PartBatch:
    """columns (B, T, J, 6) of the whole body; step of the training."""

    columns: Tensor
    step: int


class RotationDrawer:
    """Draws windows: each clip as often as any other, however long it is, as in the paper."""

    def __init__(self, clips: Sequence[RotationClip], window: int):
        self.clips, self.window = clips, window

    def draw(self, rng: RowRandom) -> PartBatch:
        windows = []
        for own in rng.rows:
            local = self.clips[int(own.integers(len(self.clips)))].local
            start = int(own.integers(len(local) - self.window + 1))
            windows.append(local[start : start + self.window])
        return PartBatch(columns_of(torch.from_numpy(np.stack(windows))), rng.step)


class PartsTask(TrainingTask[nn.ModuleDict]):
    """Training the sub-models of one decomposition, or one of them."""

    def __init__(
        self,
        config: Config,
        body: RigBodyJoints,
        clips: Sequence[RotationClip],
        held_back: Sequence[RotationClip],
        device: torch.device,
    ):
        self.config, self.device = config, device
        self.parts = [body_part(name, body.parents, body.groups) for name in config.trained]
        self.offsets = {part.name: torch.from_numpy(body.offsets[part.joints]).to(device) for part in self.parts}
        self._drawer = RotationDrawer(clips, config.window)
        mean = self._drawer.draw(_fixed(_MEAN, _MEAN_WINDOWS)).columns.mean((0, 1))
        self.networks = nn.ModuleDict({part.name: self._network(part, mean) for part in self.parts}).to(device)
        self.held_back = RotationDrawer(held_back, config.window).draw(_fixed(_VALIDATION, _VALIDATION_WINDOWS))

    def _network(self, part: BodyPart, mean: Tensor) -> PartNetwork:
        torch.manual_seed(_seed_of(self.config.seed, part.name))  # parameters have no other generator
        network = network_of_part(self.config, part)
        network.mean.copy_(mean[part.joints])
        return network

    def drawer(self, *, elsewhere: bool = False) -> RotationDrawer:
        return self._drawer

    def splits(self) -> bool:
        return self.config.network in ("ae", "pae")  # the others draw latents for a whole batch

    def rate(self, step: int) -> float | None:
        """Triangular cycles, each lower than the one before it."""
        cycle, place = divmod(step, self.config.cycle)
        height = 1 - abs(2 * (place + 1) / self.config.cycle - 1)
        low = self.config.cycle_low
        return self.config.learning_rate * self.config.cycle_decay**cycle * (low + (1 - low) * height)

    def divergence_weight(self, step: int) -> float:
        """Cyclical annealing: in each cycle from 0 to `kl_weight`, which then stays to the cycle's end."""
        length = self.config.steps / self.config.kl_cycles
        return self.config.kl_weight * min(1.0, step % length / length / _RISING)

    def loss(self, batch: PartBatch, generator: torch.Generator) -> tuple[Tensor, dict[str, Tensor]]:
        """The sum of the parts' losses, whose gradients do not mix."""
        config = self.config
        total = torch.zeros((), device=self.device)
        figures = {}
        for part in self.parts:
            own = torch.Generator(self.device).manual_seed(_seed_of(generator.initial_seed(), part.name))
            terms, divergence = self._terms(part, batch.columns.to(self.device), own, sampled=True)
            network = self.networks[part.name]
            size = torch.stack([value.abs().sum() for value in network.parameters()]).sum()
            value = weighted_sum(terms, config.loss.model_dump())
            value = value + self.divergence_weight(batch.step) * divergence + config.l1_weight * size
            total = total + value
            figures |= {f"{part.name}_mpjae": terms["mpjae"].detach()}
            if config.network in ("vae", "svae"):
                figures |= {f"{part.name}_divergence": divergence.detach()}
        return total, figures

    def _terms(
        self, part: BodyPart, columns: Tensor, generator: torch.Generator | None, *, sampled: bool
    ) -> tuple[dict[str, Tensor], Tensor]:
        network = self.networks[part.name]
        assert isinstance(network, PartNetwork)
        truth = columns[:, :, torch.from_numpy(part.joints)]
        latent, divergence = network.encode(truth, generator, sampled=sampled)
        terms = reconstruction_terms(network.decode(latent), truth, self.offsets[part.name], part.parents)
        return terms, divergence.mean()

    def validate(self) -> dict[str, float]:
        """The reconstruction loss summed over the parts, and the angles of each in degrees, latents not drawn."""
        score, angles = 0.0, {}
        for part in self.parts:
            terms, _ = self._terms(part, self.held_back.columns.to(self.device), None, sampled=False)
            score += float(weighted_sum(terms, self.config.loss.model_dump()))
            angles[f"{part.name}_deg"] = float(torch.rad2deg(terms["mpjae"]))
        return {"score": score, **angles}


def network_of_part(config: Config, part: BodyPart) -> PartNetwork:
    """The network of one part; each part has an equal share of the body's latent."""
    share = config.latent // config.parts
    return NETWORKS[config.network](len(part.joints), config.window, share, config.blocks, config.rate_hz)


def _seed_of(seed: int, name: str) -> int:
    words = np.random.SeedSequence((seed, PART_NAMES.index(name))).generate_state(1, np.uint64)
    return int(words[0] >> 1)


def _fixed(purpose: int, windows: int) -> RowRandom:
    return step_random(HELD_BACK_SEED, purpose, 0, range(windows))
