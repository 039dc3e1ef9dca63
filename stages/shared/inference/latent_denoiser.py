"""A denoiser of latents in use: loaded from its checkpoint, run over clips of any length and any rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError
from data_schemas.manifest import open_artefact
from data_schemas.trainings import last_sentence
from stages.shared.inference.bounded_network import MOST_WINDOW, whole_setting
from stages.shared.inference.models import (
    Autoencoder,
    Span,
    blended_windows,
    load_synthesiser,
    rows_of,
    whole_windows,
)
from stages.shared.networks.pumps.synthesiser import LatentSynthesiser

STARTS = ("mended", "noisy")


@dataclass(frozen=True)
class LatentDenoiser:
    """A trained denoiser and the autoencoder whose latents it corrects.

    window: frames of a training window, and of a window in use. start: "mended" or "noisy", the motion whose latents
    it was trained to correct.
    """

    network: LatentSynthesiser
    autoencoder: Autoencoder
    window: int
    start: str
    licences: tuple[str, ...]
    trained_on: str

    @property
    def device(self) -> torch.device:
        return self.autoencoder.device

    def spans(self, frames: int) -> list[Span]:
        """The windows in which a clip of this many frames is corrected, in order."""
        return whole_windows(frames, self.window)

    def corrected(
        self, latents: Tensor, centroids: Tensor, times: Tensor, spans: Sequence[Span]
    ) -> tuple[Tensor, Tensor]:
        """Latents (T, D) and centroids (T, 3), corrected in windows that are blended; as given outside of them.

        Args:
            latents: (T, D). centroids: (T, 3) metres. times: (T,) model frames, rising. spans: in these frames.
        """
        times = times.to(self.device, torch.float32)

        def made(some: list[Span]) -> tuple[Tensor, Tensor]:
            read = [rows_of(part, some) for part in (latents, centroids, times)]
            given = torch.ones(read[2].shape, dtype=torch.bool, device=self.device)
            return self.network.refine(read[0], read[1], given, read[2])

        return blended_windows(spans, (latents, centroids), made)


def load_denoiser(path: str | Path, autoencoder: Autoencoder) -> LatentDenoiser:
    """The denoiser of a checkpoint of `pumps train denoiser`, beside the autoencoder that it was trained with.

    Raises: InputError if the checkpoint is of another kind, or was trained with another autoencoder.
    """
    artefact = open_artefact(path, "checkpoint")
    kept = read_checkpoint(artefact, optimiser=False)
    config = kept.config
    if config.get("network") != "denoiser" or config.get("start") not in STARTS:
        raise InputError(
            f"{path} holds no denoiser of latents.", "Give the folder that `pumps train denoiser` wrote."
        )
    if config.get("encoder_digest") != autoencoder.digest:
        raise InputError(
            f"The denoiser in {path} was trained with another autoencoder than that of the weights given.",
            "Give --fill the weights that it was trained --from.",
        )
    return LatentDenoiser(
        load_synthesiser(kept, autoencoder, path),
        autoencoder,
        whole_setting(config, "window", MOST_WINDOW, path),
        config["start"],
        tuple(artefact.manifest.licences),
        last_sentence(kept.trainings),
    )
