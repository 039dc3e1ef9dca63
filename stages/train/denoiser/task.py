"""Training a denoiser of latents: latents of noisy or mended windows in, latents of the clean windows out.

The network is the synthesiser of trained weights, every frame of which is refined (`LatentSynthesiser.refine`). Its
output layer starts at zero, so that training starts at what the motion is. The loss is that of `pumps train lms`: the
distance of the clouds that the frozen decoder makes of its latents and of the clean ones.
"""

from __future__ import annotations

import torch
from torch import Tensor

from stages.shared.inference.models import Models
from stages.shared.kinematics.device import onto
from stages.shared.networks.layers.attention import clear_linear
from stages.shared.networks.layers.device import precision
from stages.shared.networks.pumps.synthesiser import LatentSynthesiser
from stages.shared.training.frozen_autoencoder import FrozenAutoencoder, latent_errors, latent_loss, mean_squares
from stages.shared.training.task import Drawer, TrainingTask, step_generator
from stages.shared.training.windows import WindowPool
from stages.train.denoiser.config import Config
from stages.train.denoiser.drawing import NoisyBatch, NoisyDrawer, held_back_batches
from stages.train.denoiser.noisy_windows import NO_NOISE

_IDENTITIES = 14  # the purpose of the generators


class DenoiserTask(TrainingTask[LatentSynthesiser]):
    """Training the denoiser behind a frozen autoencoder."""

    def __init__(self, config: Config, models: Models, pool: WindowPool, held_back: WindowPool, device: torch.device):
        self.config, self.device = config, device
        coder = models.autoencoder
        self.frozen = FrozenAutoencoder(coder.encoder, coder.decoder, coder.window, device, config.mixed_precision)
        self.networks = models.synthesiser.to(device).requires_grad_(True)
        clear_linear(self.networks.out)
        self._drawer = NoisyDrawer(config, pool)
        self.held_back = held_back_batches(config, held_back)

    def drawer(self, *, elsewhere: bool = False) -> Drawer:
        return self._drawer

    def splits(self) -> bool:
        return True

    def weight(self, batch: NoisyBatch, rows: int) -> float:
        """The loss is a mean over real frames."""
        return float(batch.valid.sum())

    def loss(self, batch: NoisyBatch, generator: torch.Generator) -> tuple[Tensor, dict[str, Tensor]]:
        made, start = self._errors(batch)
        value = latent_loss(made, self.config.latent_weight)
        return value, {f"{name}_of_start": (made[name] / start[name].clamp_min(1e-6)).detach() for name in made}

    def validate(self) -> dict[str, float]:
        """For each noise the distance of the decoded clouds from those of the clean latents, mm, of the network's
        latents and of those that it starts from; `score` is the mean over noises of the former."""
        figures: dict[str, float] = {}
        means = []
        for noise, batch in self.held_back.items():
            made, start = self._errors(batch)
            means.append(1000 * float(made["cloud"]))
            figures[f"{noise}_mm"] = means[-1]
            if noise != NO_NOISE:
                figures[f"{noise}_mm_of_start"] = 1000 * float(start["cloud"])
        return {"score": sum(means) / len(means), **figures}

    def _errors(self, batch: NoisyBatch) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
        """`latent_errors` of real frames: of the network's latents, and of those that it starts from."""
        valid, groups = onto(batch.valid, self.device), onto(batch.groups, self.device)
        clean, start = (self._encoded(onto(part, self.device), groups) for part in (batch.points, batch.start))
        rows = batch.rows or tuple(range(len(valid)))
        random = step_generator(self.config.seed, _IDENTITIES, max(batch.step, 0), rows, self.device)
        identities = self.frozen.decoder.draw_noise(len(valid), groups.shape[1], random)
        times = torch.arange(float(valid.shape[1]), device=self.device).unsqueeze(0)
        with precision(self.device, self.config.mixed_precision):
            with torch.no_grad():
                truth, before = (self.frozen.decode(*each, groups, identities) for each in (clean, start))
            made = self.networks.refine(*start, valid, times, valid)
            after = self.frozen.decode(*made, groups, identities)
        return (
            latent_errors(mean_squares(after, truth), made[0], clean[0], valid),
            latent_errors(mean_squares(before, truth), start[0], clean[0], valid),
        )

    def _encoded(self, points: Tensor, groups: Tensor) -> tuple[Tensor, Tensor]:
        """Latents (B, T, D) and centroids (B, T, 3) of clouds (B, T, P, 3)."""
        batch, frames = points.shape[:2]
        latents, centroids = self.frozen.encode_frames(points.flatten(0, 1), groups.repeat_interleave(frames, 0))
        return latents.unflatten(0, (batch, frames)), centroids.unflatten(0, (batch, frames))
