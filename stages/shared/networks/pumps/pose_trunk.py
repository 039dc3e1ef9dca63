"""The synthesiser between two MLPs, which project a pose space into its latent space and back (PUMPS 5)."""

from __future__ import annotations

from torch import Tensor, nn

from stages.shared.networks.layers.attention import clear_linear
from stages.shared.networks.layers.sizes import SynthesiserSizes
from stages.shared.networks.pumps.synthesiser import LatentSynthesiser


class PoseTrunk(nn.Module):
    """Features of frames in, outputs of frames out, through a synthesiser that was trained on latents or is new.

    Args:
        features: of a frame. outputs: of a frame; zero before training.
        latent_width: of the synthesiser.
    """

    def __init__(self, features: int, outputs: int, latent_width: int, sizes: SynthesiserSizes):
        super().__init__()
        width = sizes.width
        self.sizes, self.latent_width = sizes, latent_width
        self.input = nn.Sequential(nn.Linear(features, 2 * width), nn.GELU(), nn.Linear(2 * width, latent_width + 3))
        self.synthesiser = LatentSynthesiser(latent_width, sizes)
        self.output = nn.Sequential(nn.Linear(latent_width + 3, 2 * width), nn.GELU(), nn.Linear(2 * width, outputs))
        clear_linear(self.output[-1])

    def forward(self, features: Tensor, given: Tensor, times: Tensor, valid: Tensor | None = None) -> Tensor:
        """Args:
            features: (B, T, F), about 1 in size. given: (B, T) True where they may be read, one or more in a row.
            times: (B or 1, T) model frames. valid: (B, T) True for real frames; None for all.

        Returns: (B, T, outputs).
        """
        latents = self.input(features)
        made, centroids = self.synthesiser.refine(latents[..., :-3], latents[..., -3:], given, times, valid)
        return self.output(nn.functional.pad(made, (0, 3)) + nn.functional.pad(centroids, (self.latent_width, 0)))
