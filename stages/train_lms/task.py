"""Training the latent motion synthesiser with a frozen encoder (PUMPS 3.3): batches, loss, validation.

Latents are drawn afresh at every step, from freshly drawn points of augmented windows: breadth is what a small
synthesiser lacks first. What it learns is a residual on the latents of the skeleton's own plain interpolation of the
keys (`SynthesiserSizes.base`), encoded from the same points, so that what the autoencoder gets wrong in both cancels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from stages.kinematics.conventions import MODEL_FPS
from stages.kinematics.window_interpolation import interpolate_windows
from stages.networks.device import precision
from stages.networks.frame_encoder import FrameEncoder
from stages.networks.synthesiser import LatentSynthesiser, interpolate_known
from stages.train_lms.config import Config
from stages.training.masks import draw_known
from stages.training.task import step_seed
from stages.training.windows import WindowPool, Windows, clouds_of, draw_clouds, known_centre

# Errors below these (latents' mean square; metres squared) count as none: a window where nothing moves has no share.
_NOTHING = torch.tensor([0.01, 0.01**2])


@dataclass
class FillBatch:
    """points and base (B, T, P, 3) metres, groups (B, P), known and valid (B, T)."""

    points: Tensor
    base: Tensor | None
    groups: Tensor
    known: Tensor
    valid: Tensor


class SynthesiserTask:
    """A `Task` of the training loop."""

    def __init__(
        self, config: Config, encoder: FrameEncoder, pool: WindowPool, held_back: WindowPool, device: torch.device
    ):
        self.config, self.pool, self.device = config, pool, device
        self.encoder = encoder.to(device).eval().requires_grad_(False)
        torch.manual_seed(config.seed)
        self.networks = LatentSynthesiser(encoder.latent_width, config.synthesiser).to(device)
        self.held_back = list(self._validation(held_back))

    def draw(self, rng: np.random.Generator) -> FillBatch:
        config = self.config
        windows = self.pool.draw(config.batch, config.window, rng, augment=config.augment)
        known = draw_known(windows.valid.sum(1), config.window, config.longest_gap, rng)
        return self._clouds(windows, known, rng, augment=config.augment)

    def _validation(self, pool: WindowPool) -> list[tuple[str, FillBatch]]:
        """The same held-back windows with keys every 5, 15 and 30 frames, and a prediction."""
        config, batches = self.config, []
        windows = pool.draw(32, config.window, step_seed(config.seed, 5, 0), augment=False)
        frames = torch.arange(config.window)
        lengths = windows.valid.sum(1, keepdim=True)
        for every in (5, 15, 30):
            known = ((frames % every == 0) | (frames == lengths - 1)) & windows.valid
            batches.append(
                (str(every), self._clouds(windows, known, step_seed(config.seed, 6, every), augment=False))
            )
        known = (frames < lengths - 15) & windows.valid
        batches.append(("predict", self._clouds(windows, known, step_seed(config.seed, 6, 0), augment=False)))
        return batches

    def _clouds(self, windows: Windows, known: Tensor, rng: np.random.Generator, *, augment: bool) -> FillBatch:
        config = self.config
        cloud = draw_clouds(windows, config.points, (config.sigma_min_m, config.sigma_max_m), rng, augment=augment)
        centre = known_centre(windows.heads, known)
        points = clouds_of(windows.heads, windows.rotations, cloud, centre)
        base = None
        if config.synthesiser.base == "skeleton":
            plain = interpolate_windows(windows.heads, windows.rotations, windows.parents, known, rate_hz=MODEL_FPS)
            base = clouds_of(*plain, cloud, centre)
        return FillBatch(points, base, cloud.groups, known, windows.valid)

    def _encode(self, points: Tensor, groups: Tensor) -> tuple[Tensor, Tensor]:
        """points (N, P, 3), groups (N, P) -> latents, centroids; no gradient."""
        with torch.no_grad(), precision(self.device, self.config.mixed_precision):
            return self.encoder(points, groups)

    def _predict(self, batch: FillBatch) -> tuple[Tensor, Tensor]:
        """Squared errors (B, 2) of each window's latents and centroids (metres) where frames are missing: of the
        network, and of the base alone."""
        device = self.device
        known, valid = batch.known.to(device), batch.valid.to(device)
        frames = known.shape[1]
        groups = batch.groups.to(device).unsqueeze(1).expand(-1, frames, -1)
        missing = valid & ~known
        # The base equals the truth at the keys, so only the missing frames of it are encoded.
        latents = torch.zeros(*known.shape, self.encoder.latent_width, device=device)
        centroids = torch.zeros(*known.shape, 3, device=device)
        latents[valid], centroids[valid] = self._encode(batch.points.to(device)[valid], groups[valid])
        times = torch.arange(frames, device=device).unsqueeze(0)
        if batch.base is None:
            every = times.expand_as(known)
            base = interpolate_known(latents, known, every), interpolate_known(centroids, known, every)
        else:
            base = latents.clone(), centroids.clone()
            base[0][missing], base[1][missing] = self._encode(batch.base.to(device)[missing], groups[missing])
        with precision(device, self.config.mixed_precision):
            made = self.networks(latents, centroids, known, times, valid, base)
        errors = []
        for guess in (made, base):
            latent, place = (guess[0] - latents).square().mean(-1), (guess[1] - centroids).square().sum(-1)
            both = torch.stack([latent, place], dim=-1) * missing.unsqueeze(-1)
            errors.append(both.sum(1) / missing.sum(1, keepdim=True).clamp_min(1))
        return errors[0], errors[1]

    def loss(self, batch: FillBatch, generator: torch.Generator) -> tuple[Tensor, dict[str, float]]:
        """Each window's error as a share of its base's: otherwise long gaps, whose errors are a hundred times those
        of short ones, would be all that is learnt."""
        made, base = self._predict(batch)
        shares = (made + _NOTHING.to(made)) / (base + _NOTHING.to(made))
        weights = torch.tensor([1.0, self.config.centroid_weight], device=made.device)
        value = (shares * weights).sum(-1).mean() / weights.sum()
        latent, place = shares.detach().mean(0)
        return value, {"latent_of_base": float(latent), "centroid_of_base": float(place)}

    def validate(self) -> dict[str, float]:
        """The squared error as a share of the base's, for keys every 5, 15, 30 frames and a prediction."""
        shares: dict[str, float] = {}
        places: dict[str, float] = {}
        for name, batch in self.held_back:
            made, base = self._predict(batch)
            latent, place = (made.mean(0) / base.mean(0).clamp_min(1e-12)).tolist()
            shares[f"latent_of_base_{name}"], places[f"centroid_of_base_{name}"] = latent, place
        score = float(np.mean(list(shares.values()))) + 0.5 * float(np.mean(list(places.values())))
        return {"score": score, **shares, **places}
