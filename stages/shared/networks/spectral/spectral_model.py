"""SpecTrHuMS as one module: autoencoder, running moments of its latents, motion transformer."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from stages.shared.networks.layers.sizes import SpectralSizes
from stages.shared.networks.spectral.autoencoder import SpectralAutoencoder
from stages.shared.networks.spectral.moments import RunningMoments
from stages.shared.networks.spectral.motion_transformer import MotionTransformer, filled_plainly


class SpectralModel(nn.Module):
    """Windows of spectral coefficients (B, T, k, 3) metres in and out.

    Args:
        count: k. frames: T. known: first frames that are known. last: whether the last one is known too.
        sizes: of the networks.
    """

    steps: Tensor

    def __init__(self, count: int, frames: int, known: int, last: bool, sizes: SpectralSizes):
        super().__init__()
        self.frames, self.known, self.last = frames, known, last
        self.autoencoder = SpectralAutoencoder(count, sizes)
        self.moments = RunningMoments(sizes.latent)
        self.transformer = MotionTransformer(frames, sizes)
        self.register_buffer("steps", torch.zeros((), dtype=torch.int64))  # of training, so that a resumed run agrees

    def losses(self, true: Tensor, static_steps: int) -> tuple[Tensor, Tensor]:
        """The static loss on all frames, and the loss of the transformer on standardised latents.

        The second is 0 for the first `static_steps` steps. Its gradient does not reach the encoder: a loss between
        latents would else be least where all meshes have one latent.

        Args:
            true: (B, T, k, 3). In training mode the running moments take the latents in.
        """
        latents = self.autoencoder.encode(true)
        static = self.autoencoder.loss(self.autoencoder.decode(latents), true)
        step = int(self.steps)
        if self.training:
            self.steps += 1
        if step < static_steps:
            return static, static.new_zeros(())
        fixed = latents.detach()
        if self.training:
            self.moments.add(fixed)
        standard = self.moments.standardise(fixed)
        made = self.transformer(filled_plainly(standard, self.known, self.last))
        return static, ((made - standard) ** 2).mean()

    def forward(self, coefficients: Tensor) -> Tensor:
        """Predicted coefficients (B, T, k, 3) of all frames of a window; unknown ones of the input are not read."""
        given = coefficients
        if not self.last:
            given = coefficients[:, : self.known]
            given = torch.cat([given, given[:, -1:].expand(-1, self.frames - self.known, -1, -1)], dim=1)
        standard = self.moments.standardise(self.autoencoder.encode(given))
        made = self.transformer(filled_plainly(standard, self.known, self.last))
        return self.autoencoder.decode(self.moments.restore(made))
