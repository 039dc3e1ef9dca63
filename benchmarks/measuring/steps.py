"""The steps that are timed: one call is one training step (or one forward pass) on random clouds, all of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from stages.shared.kinematics.conventions import GROUPS
from stages.shared.networks.layers.device import precision
from stages.shared.networks.layers.layer_stack import set_checkpointing
from stages.shared.networks.layers.sizes import DecoderSizes, EncoderSizes, SynthesiserSizes
from stages.shared.networks.pumps.cloud_decoder import CloudDecoder
from stages.shared.networks.pumps.frame_encoder import FrameEncoder
from stages.shared.networks.pumps.synthesiser import LatentSynthesiser
from stages.shared.pointcloud.assignment import paired_difference


@dataclass(frozen=True)
class Load:
    """How much is in a step, and where it is computed."""

    sequences: int
    frames: int
    points: int
    device: torch.device


def random_clouds(load: Load) -> tuple[Tensor, Tensor]:
    """points (B, T, P, 3) metres, about as large and as lively as a body; groups (B, P)."""
    generator = torch.Generator().manual_seed(0)
    rest = 0.3 * torch.randn(load.sequences, 1, load.points, 3, generator=generator)
    moving = 0.05 * torch.randn(load.sequences, load.frames, load.points, 3, generator=generator)
    groups = torch.randint(0, GROUPS, (load.sequences, load.points), generator=generator)
    return (rest + moving).to(load.device), groups.to(load.device)


def encoder_forward(load: Load, sizes: EncoderSizes, *, mixed: bool) -> Callable[[], object]:
    """Encode every frame, without gradient."""
    torch.manual_seed(0)
    encoder = FrameEncoder(sizes).to(load.device).eval()
    points, groups = random_clouds(load)
    flat, each = points.flatten(0, 1), groups.repeat_interleave(load.frames, 0)

    def run() -> None:
        with torch.no_grad(), precision(load.device, mixed):
            encoder(flat, each)

    return run


def autoencoder_step(
    load: Load,
    sizes: EncoderSizes,
    decoder_sizes: DecoderSizes,
    *,
    mixed: bool,
    checkpointing: bool = False,
    compiled: bool = False,
) -> Callable[[], object]:
    """Encode, decode, assign, loss, backward, clip, AdamW: as `pumps train ae` does it."""
    torch.manual_seed(0)
    encoder = FrameEncoder(sizes).to(load.device)
    decoder = CloudDecoder(encoder.latent_width, decoder_sizes).to(load.device)
    descend = _descent(nn.ModuleList([encoder, decoder]), checkpointing)
    points, groups = random_clouds(load)
    times = torch.arange(float(load.frames), device=load.device).unsqueeze(0)
    encode = torch.compile(encoder) if compiled else encoder
    decode = torch.compile(decoder) if compiled else decoder

    def run() -> None:
        with precision(load.device, mixed):
            latents, centroids = encode(points.flatten(0, 1), groups.repeat_interleave(load.frames, 0))
            latents, centroids = (part.unflatten(0, (load.sequences, -1)) for part in (latents, centroids))
            noise = decoder.draw_noise(load.sequences, load.points)
            made = decode(latents, centroids, times, groups, noise)
        descend(paired_difference(made, points, groups).square().sum(-1).mean())

    return run


def synthesiser_step(
    load: Load, sizes: EncoderSizes, filler: SynthesiserSizes, *, mixed: bool, checkpointing: bool = False
) -> Callable[[], object]:
    """Encode truth and base with the frozen encoder, fill, loss on latents and centroids, backward, clip, AdamW."""
    torch.manual_seed(0)
    encoder = FrameEncoder(sizes).to(load.device).eval().requires_grad_(False)
    network = LatentSynthesiser(encoder.latent_width, filler).to(load.device)
    descend = _descent(network, checkpointing)
    points, groups = random_clouds(load)
    known = (torch.arange(load.frames, device=load.device) % 15 == 0).expand(load.sequences, -1)
    times = torch.arange(float(load.frames), device=load.device).unsqueeze(0)
    truth, base = points.flatten(0, 1), 0.9 * points.flatten(0, 1)
    each = groups.repeat_interleave(load.frames, 0)

    def run() -> None:
        with precision(load.device, mixed):
            with torch.no_grad():
                latents, centroids = (part.unflatten(0, (load.sequences, -1)) for part in encoder(truth, each))
                plain = tuple(part.unflatten(0, (load.sequences, -1)) for part in encoder(base, each))
            made, placed = network(latents, centroids, known, times, None, plain)
        descend((made - latents).square().mean() + (placed - centroids).square().mean())

    return run


def _descent(networks: nn.Module, checkpointing: bool) -> Callable[[Tensor], None]:
    """The rest of a step: backward, clip, AdamW."""
    set_checkpointing(networks, checkpointing)
    networks.train()
    parameters = list(networks.parameters())
    optimiser = torch.optim.AdamW(parameters, lr=1e-4, fused=parameters[0].device.type == "cpu" or None)

    def descend(loss: Tensor) -> None:
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(parameters, 1.0)
        optimiser.step()

    return descend
