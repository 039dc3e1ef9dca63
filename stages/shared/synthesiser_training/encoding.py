"""From clouds to the synthesiser's training data: latents of the truth and of the base, from the frozen
autoencoder."""

from __future__ import annotations

import torch
from torch import Tensor

from stages.shared.inference.models import Autoencoder
from stages.shared.kinematics.device import onto
from stages.shared.networks.layers.device import precision
from stages.shared.networks.pumps.synthesiser import interpolate_known
from stages.shared.synthesiser_training.config import SynthesiserTrainingConfig
from stages.shared.synthesiser_training.fill_batch import FillBatch
from stages.shared.synthesiser_training.kept_windows import LatentBatch
from stages.shared.training.frozen_autoencoder import FrozenAutoencoder, mean_squares
from stages.shared.training.task import step_generator

_IDENTITIES = 7  # the purpose of the generators


class WindowEncoder(FrozenAutoencoder):
    """The frozen autoencoder of a training, on its device."""

    def __init__(self, config: SynthesiserTrainingConfig, autoencoder: Autoencoder, device: torch.device):
        parts = (autoencoder.encoder, autoencoder.decoder, autoencoder.window)
        super().__init__(*parts, device, config.mixed_precision)
        self.config = config

    def _encode_into(self, latents: Tensor, centroids: Tensor, points: Tensor, groups: Tensor, rows: Tensor) -> None:
        """Encode frames `rows` (N,), counted over all windows, of points (B, T, P, 3); write the results into latents
        (B, T, D) and centroids (B, T, 3)."""
        clouds = onto(points, self.device).flatten(0, 1)[rows]
        found = self.encode_frames(clouds, groups[rows])
        for whole, part in zip((latents, centroids), found, strict=True):
            whole.flatten(0, 1)[rows] = part

    def encode(self, batch: FillBatch) -> LatentBatch:
        """Latents of a batch and of its base, and the decoded clouds of both."""
        device = self.device
        # The frames to encode are known on the CPU: reading them from a GPU would wait for it.
        valid_rows, missing_rows = (
            onto(mask.flatten().nonzero().squeeze(1), device) for mask in (batch.valid, batch.valid & ~batch.known)
        )
        known, valid, point_groups = (onto(part, device) for part in (batch.known, batch.valid, batch.groups))
        frames = known.shape[1]
        groups = point_groups.repeat_interleave(frames, 0)
        latents = torch.zeros(*known.shape, self.encoder.latent_width, device=device)
        centroids = torch.zeros(*known.shape, 3, device=device)
        self._encode_into(latents, centroids, batch.points, groups, valid_rows)
        if batch.base is None:
            every = torch.arange(frames, device=device).expand_as(known)
            base = interpolate_known(latents, known, every), interpolate_known(centroids, known, every)
        else:
            # The base equals the truth at the keys, so only its missing frames are encoded.
            base = latents.clone(), centroids.clone()
            self._encode_into(*base, batch.base, groups, missing_rows)
        identities = self.decoder.draw_noise(len(known), point_groups.shape[1], self._identity_random(batch))
        with torch.no_grad(), precision(device, self.config.mixed_precision):
            true_clouds = self.decode(latents, centroids, point_groups, identities)
            plain = self.decode(base[0], base[1], point_groups, identities)
        return LatentBatch(
            latents, centroids, *base, point_groups, known, valid,
            identities, true_clouds, mean_squares(plain, true_clouds),
        )  # fmt: skip

    def _identity_random(self, batch: FillBatch) -> torch.Generator:
        """Generator of the decoded points' identities; a window keeps them for its round, so that the truth is
        decoded once."""
        if batch.step < 0:
            return torch.Generator(device=self.device).manual_seed(0)
        return step_generator(self.config.seed, _IDENTITIES, batch.step, batch.rows, self.device)
