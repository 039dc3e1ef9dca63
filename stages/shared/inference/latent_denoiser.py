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
from stages.shared.inference.bounded_network import MOST_WINDOW, build_bounded, whole_setting
from stages.shared.inference.models import Autoencoder, Span, batches_of, load_state, overlapping_windows, rows_of
from stages.shared.networks.layers.sizes import SynthesiserSizes
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
        windows = overlapping_windows(frames, self.window)
        return [Span(start, stop, start, stop, fade) for start, stop, fade in windows]

    def corrected(
        self, latents: Tensor, centroids: Tensor, times: Tensor, spans: Sequence[Span]
    ) -> tuple[Tensor, Tensor]:
        """Latents (T, D) and centroids (T, 3), corrected in windows that are blended; as given outside of them.

        Args:
            latents: (T, D). centroids: (T, 3) metres. times: (T,) model frames, rising. spans: in these frames.
        """
        out = torch.zeros_like(latents), torch.zeros_like(centroids)
        weights = torch.zeros(len(times), 1, device=self.device)
        times = times.to(self.device, torch.float32)
        with torch.inference_mode():
            for some in batches_of(spans):
                read = [rows_of(part, some) for part in (latents, centroids, times)]
                given = torch.ones(read[2].shape, dtype=torch.bool, device=self.device)
                made = self.network.refine(read[0], read[1], given, read[2])
                for number, span in enumerate(some):
                    fade = span.fade.to(self.device).unsqueeze(1)
                    for whole, part in zip(out, made, strict=True):
                        whole[span.start : span.stop] += fade * part[number]
                    weights[span.start : span.stop] += fade
        seen = weights > 0
        return (
            torch.where(seen, out[0] / weights.clamp_min(1e-9), latents),
            torch.where(seen, out[1] / weights.clamp_min(1e-9), centroids),
        )


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
    network = build_bounded(
        lambda: LatentSynthesiser(autoencoder.encoder.latent_width, SynthesiserSizes(**config["synthesiser"])),
        config.get("synthesiser"),
        kept.weights,
        path,
    )
    load_state(network, kept.weights, path)
    return LatentDenoiser(
        network.to(autoencoder.device).eval(),
        autoencoder,
        whole_setting(config, "window", MOST_WINDOW, path),
        config["start"],
        tuple(artefact.manifest.licences),
        last_sentence(kept.trainings),
    )
