"""Training the autoencoder of clouds (PUMPS 3.1, 3.2): batches, loss, validation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from stages.shared.kinematics.device import onto
from stages.shared.networks.layers.device import precision
from stages.shared.networks.pumps.cloud_decoder import CloudDecoder
from stages.shared.networks.pumps.frame_encoder import FrameEncoder
from stages.shared.pointcloud.assignment import paired_difference
from stages.shared.pointcloud.reconstruction import distances, nearest_differences, spread_ratios
from stages.shared.training.task import HELD_BACK_SEED, RowRandom, TrainingTask
from stages.shared.training.windows import WindowPool, Windows, clouds_of, draw_clouds, known_centre
from stages.train.ae.config import Config

_UNIT_M = 0.1  # the loss is in squared decimetres, so that it is near 1 at the start


class AutoencoderNetworks(nn.Module):
    """Encoder and decoder together."""

    def __init__(self, config: Config):
        super().__init__()
        self.encoder = FrameEncoder(config.encoder)
        self.decoder = CloudDecoder(self.encoder.latent_width, config.decoder)


@dataclass
class CloudBatch:
    """points (B, T, P, 3) metres, groups (B, P), valid (B, T)."""

    points: Tensor
    groups: Tensor
    valid: Tensor


class Reconstruction(NamedTuple):
    """made and points (B, T, P, 3) metres, groups (B, P), valid (B, T), divergence (B, T, P) of codes, nats."""

    made: Tensor
    points: Tensor
    groups: Tensor
    valid: Tensor
    divergence: Tensor


class CloudDrawer:
    """Draws windows and the clouds on them."""

    def __init__(self, config: Config, pool: WindowPool):
        self.config, self.pool = config, pool

    def draw(self, rng: RowRandom) -> CloudBatch:
        config = self.config
        windows = self.pool.draw(
            len(rng.rows), config.window, rng, augment=config.augment, proportions=config.proportions
        )
        even = math.floor((rng.step + 1) * config.even_share) > math.floor(rng.step * config.even_share)
        return self.clouds(windows, rng, augment=config.augment, even=even)[0]

    def clouds(
        self, windows: Windows, rng: np.random.Generator, *, augment: bool, copies: int = 1, even: bool = False
    ) -> list[CloudBatch]:
        """Clouds of the windows; further copies are other draws of points with the same groups and the same
        placement."""
        config = self.config
        centre = known_centre(windows.heads, windows.valid)
        sigma = (config.sigma_min_m, config.sigma_max_m)
        cloud = draw_clouds(windows, config.points, sigma, rng, augment=augment, even=even)
        batches = []
        for _ in range(copies):
            points = clouds_of(windows.heads, windows.rotations, cloud, centre)
            batches.append(CloudBatch(points, cloud.drawn.groups, windows.valid))
            cloud = cloud.redrawn(windows, rng)
        return batches


class AutoencoderTask(TrainingTask[AutoencoderNetworks]):
    """Training the encoder and decoder together."""

    def __init__(self, config: Config, pool: WindowPool, held_back: WindowPool, device: torch.device):
        self.config, self.device = config, device
        self._drawer = CloudDrawer(config, pool)
        torch.manual_seed(config.seed)  # weights are drawn only here; parameters have no other generator
        self.networks = AutoencoderNetworks(config).to(device)
        rng = np.random.default_rng((HELD_BACK_SEED, 7))
        windows = held_back.draw(32, config.window, rng, augment=False)
        self.held_back = self._drawer.clouds(windows, rng, augment=False, copies=2)

    def drawer(self, *, elsewhere: bool = False) -> CloudDrawer:
        return self._drawer

    def splits(self) -> bool:
        return True

    def _reconstruct(self, batch: CloudBatch, seed: torch.Generator) -> Reconstruction:
        points, groups, valid = (onto(part, self.device) for part in (batch.points, batch.groups, batch.valid))
        encoder, decoder = self.networks.encoder, self.networks.decoder
        frames = points.shape[1]
        with precision(self.device, self.config.mixed_precision):
            latents, centroids = encoder(points.flatten(0, 1), groups.repeat_interleave(frames, 0))
            latents, centroids = latents.unflatten(0, (-1, frames)), centroids.unflatten(0, (-1, frames))
            times = torch.arange(frames, device=self.device).unsqueeze(0)
            noise = decoder.draw_noise(len(points), points.shape[2], seed)
            features = decoder.frame_features(latents, centroids, times, valid, seed)
            made = decoder.place_points(features, centroids, groups, noise)
            divergence = decoder.divergence(features, groups)
        return Reconstruction(made, points, groups, valid, divergence)

    def loss(self, batch: CloudBatch, generator: torch.Generator) -> tuple[Tensor, dict[str, Tensor]]:
        made, points, groups, valid, divergence = self._reconstruct(batch, generator)
        count = self.config.loss_points
        if 0 < count < points.shape[2]:
            # Noise and points are drawn independently, so any subset can be used; groups stay equal on both sides.
            made, points, groups = made[:, :, :count], points[:, :, :count], groups[:, :count]
        choose_pairs = nearest_differences if self.config.loss == "chamfer" else paired_difference
        moving, static = split_over_time(choose_pairs(made, points, groups, valid) / _UNIT_M, valid)
        value = static + (1 + self.config.variation_weight) * moving
        # Measurements stay on the device: reading them would wait for it.
        figures = {"rec": (static + moving).detach(), "moving": moving.detach()}
        if self.config.decoder.identities == "vae":
            # -log p = half the squared distance over the observation's variance, here one unit, plus the divergence.
            keep = valid.unsqueeze(-1).to(divergence.dtype)
            nats = ((divergence * keep).mean(2).sum(1) / keep.sum((1, 2)).clamp_min(1)).mean()  # a mean over windows
            value = value + 2 * self.config.prior_weight * nats
            figures["divergence"] = nats.detach()
        return value, figures

    def validate(self) -> dict[str, float]:
        """Measurements in millimetres: matched pairs' distance (`rec_mm`), the same between two true draws
        (`reference_mm`), how both vary over time, and the spread ratio. `score` is
        the variation plus a tenth of rec."""
        batch, other = self.held_back
        generator = torch.Generator(device=self.device).manual_seed(0)
        made, points, groups, valid, _ = self._reconstruct(batch, generator)
        apart = paired_difference(made, points, groups, valid)
        truth = paired_difference(other.points.to(self.device), points, groups, valid)
        rec, moving, _ = (1000 * float(part.mean()) for part in distances(apart, valid))
        reference, reference_moving, _ = (1000 * float(part.mean()) for part in distances(truth, valid))
        figures = {"score": moving + 0.1 * rec, "rec_mm": rec, "reference_mm": reference}
        figures |= {"moving_mm": moving, "reference_moving_mm": reference_moving}
        figures["spread_ratio"] = float(spread_ratios(made, points, groups).nanmean())
        return figures


def split_over_time(apart: Tensor, valid: Tensor) -> tuple[Tensor, Tensor]:
    """Mean square of pairs' differences (B, T, P, 3), split into the part that varies over time and the constant
    part."""
    keep = valid[..., None, None].to(apart.dtype)
    frames = keep.sum(1, keepdim=True).clamp_min(1)
    constant = (apart * keep).sum(1, keepdim=True) / frames
    varying = ((apart - constant) * keep).square().sum(-1).sum(1) / frames.squeeze(1).squeeze(-1)
    return varying.mean(), constant.square().sum(-1).mean()
