"""The steps that are timed: one step of a training, with its own loss, on random clouds; or one forward pass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from stages.shared.inference import models
from stages.shared.kinematics.conventions import GROUPS
from stages.shared.networks.layers.device import precision
from stages.shared.networks.layers.layer_stack import set_checkpointing
from stages.shared.networks.layers.sizes import EncoderSizes
from stages.shared.networks.pumps.frame_encoder import FrameEncoder
from stages.shared.networks.pumps.synthesiser import LatentSynthesiser
from stages.shared.synthesiser_training.encoding import WindowEncoder
from stages.shared.synthesiser_training.fill_batch import FillBatch
from stages.shared.synthesiser_training.task import SynthesiserTask
from stages.shared.training.config import TrainingConfig
from stages.shared.training.optimiser import Optimiser
from stages.train.ae.config import Config as AutoencoderConfig
from stages.train.ae.task import AutoencoderNetworks, AutoencoderTask, CloudBatch
from stages.train.lms.config import Config as SynthesiserConfig


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
    load: Load, config: AutoencoderConfig, *, checkpointing: bool = False, compiled: bool = False
) -> Callable[[], object]:
    """Encode, decode, the loss of `pumps train ae`, backward, clip, step of its optimiser."""
    task = _AutoencoderOnRandomClouds(config, load.device)
    if compiled:
        networks = task.networks
        networks.encoder.compile()
        networks.decoder.frame_features = torch.compile(networks.decoder.frame_features)
        networks.decoder.place_points = torch.compile(networks.decoder.place_points)
    points, groups = random_clouds(load)
    batch = CloudBatch(points, groups, torch.ones(points.shape[:2], dtype=torch.bool, device=load.device))
    return _step_of(task, batch, config, checkpointing)


def synthesiser_step(
    load: Load, ae: AutoencoderConfig, config: SynthesiserConfig, *, checkpointing: bool = False
) -> Callable[[], object]:
    """Encode truth and base with the frozen encoder, fill, decode, the loss of `pumps train lms`, backward, clip, a
    step of its optimiser; keys every 15 frames, windows that serve in one step."""
    config = config.model_copy(update={"reuse": 1})
    task = _SynthesiserOnRandomClouds(config, ae, load)
    points, groups = random_clouds(load)
    valid = torch.ones(points.shape[:2], dtype=torch.bool)
    known = (torch.arange(load.frames) % 15 == 0).expand(load.sequences, -1)
    return _step_of(task, FillBatch(points, 0.9 * points, groups, known, valid), config, checkpointing)


class _AutoencoderOnRandomClouds(AutoencoderTask):
    """The training's task without windows to draw."""

    def __init__(self, config: AutoencoderConfig, device: torch.device):
        self.config, self.device = config, device
        torch.manual_seed(0)
        self.networks = AutoencoderNetworks(config).to(device)


class _SynthesiserOnRandomClouds(SynthesiserTask):
    """The training's task without windows to draw, on an autoencoder that has learnt nothing."""

    def __init__(self, config: SynthesiserConfig, ae: AutoencoderConfig, load: Load):
        self.config, self.device = config, load.device
        torch.manual_seed(0)
        fresh = AutoencoderNetworks(ae)
        frozen = models.Autoencoder(fresh.encoder, fresh.decoder, ae.window, ae.points, (), "", load.device)
        self.frozen = WindowEncoder(config, frozen, load.device)
        self.networks = LatentSynthesiser(fresh.encoder.latent_width, config.synthesiser).to(load.device)


def _step_of(
    task: AutoencoderTask | SynthesiserTask, batch: Any, config: TrainingConfig, checkpointing: bool
) -> Callable[[], object]:
    """One training step on a batch: loss, backward, clip, optimiser."""
    set_checkpointing(task.networks, checkpointing)
    task.networks.train()
    optimiser = Optimiser(task.networks, config)
    parameters = list(task.networks.parameters())
    generator = torch.Generator(device=task.device).manual_seed(0)

    def run() -> None:
        optimiser.zero_grad()
        loss, _ = task.loss(batch, generator)
        loss.backward()
        nn.utils.clip_grad_norm_(parameters, config.clip_norm)
        optimiser.step(config.learning_rate)

    return run
