"""A sequence of layers, whose inner results may be computed again in the backward pass instead of kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import torch
from torch import Tensor, nn
from torch.utils.checkpoint import checkpoint


@runtime_checkable
class GrowingLayer(Protocol):
    """A layer that can be added to trained layers without changing their output."""

    def begin_as_identity(self) -> None:
        """Make the layer the identity until it is trained."""
        ...


class Checkpointed:
    """A module that can keep only its inputs for the backward pass (activation checkpointing).

    checkpointing: whether it does; `set_checkpointing` sets it.
    """

    checkpointing: bool = False


def set_checkpointing(networks: nn.Module, on: bool) -> None:
    """Turn activation checkpointing on or off in all modules that can do it."""
    for module in networks.modules():
        if isinstance(module, Checkpointed):
            module.checkpointing = on


class LayerStack(nn.ModuleList, Checkpointed):
    """Layers that each map (B, T, width) to (B, T, width), and share all other arguments. With checkpointing only
    each layer's input is kept."""

    def forward(self, frames: Tensor, *shared: Any, **named: Any) -> Tensor:
        """All layers in turn, (B, T, width)."""
        for layer in self:
            frames = run_again(self.checkpointing, layer, frames, *shared, **named)
        return frames


def run_again(again: bool, run: Callable[..., Tensor], *given: Any, **named: Any) -> Tensor:
    """`run(*given, **named)`; with `again` its inner results are not kept but computed a second time in the backward
    pass. It must draw no random numbers."""
    if again and torch.is_grad_enabled():
        return checkpoint(run, *given, use_reentrant=False, preserve_rng_state=False, **named)  # pyright: ignore
    return run(*given, **named)
