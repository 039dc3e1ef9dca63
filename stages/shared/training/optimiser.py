"""The optimiser of a training: AdamW for all weights, or Muon for the matrices of layers and AdamW for the rest.

With Muon (`muon.py`) directions that few windows change move as far as common ones; both optimisers use the same
learning rate. AdamW updates embeddings, the last layer and all parameters that are not matrices.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor, nn

from stages.shared.training.config import TrainingConfig
from stages.shared.training.muon import Muon

_OF_MUON, _OF_ADAMW = ("momentum_buffer",), ("step", "exp_avg", "exp_avg_sq")


def inner_matrices(networks: nn.Module) -> list[str]:
    """Names of the matrices of repeated layers, which Muon updates."""
    listed = [name for name, module in networks.named_modules() if isinstance(module, nn.ModuleList)]
    return [
        name
        for name, value in networks.named_parameters()
        if value.ndim == 2 and any(name.startswith(f"{each}.") for each in listed)
    ]


class Optimiser:
    """Updates a network's parameters by name."""

    def __init__(self, networks: nn.Module, config: TrainingConfig):
        self.named = dict(networks.named_parameters())
        device = next(iter(self.named.values())).device
        inner = inner_matrices(networks) if config.optimiser == "muon" else []
        matrices = [self.named[name] for name in inner]
        others = [value for name, value in self.named.items() if name not in set(inner)]
        rate, decay = config.learning_rate, config.weight_decay
        self._parts: list[
            tuple[torch.optim.Optimizer, tuple[str, ...]]
        ] = []  # each optimiser with the keys of its state
        if matrices:
            muon = Muon(matrices, lr=rate, weight_decay=decay)
            self._parts.append((muon, _OF_MUON))
        if others:
            # Fused, each parameter and its moments are read once from memory, which takes a third of the time.
            fused = device.type == "cpu" or None
            adamw = torch.optim.AdamW(others, lr=rate, betas=(0.9, 0.98), weight_decay=decay, fused=fused)
            self._parts.append((adamw, _OF_ADAMW))

    def zero_grad(self) -> None:
        """Clear all gradients."""
        for part, _ in self._parts:
            part.zero_grad(set_to_none=True)

    def step(self, rate: float) -> None:
        """One step at a learning rate."""
        for part, _ in self._parts:
            for group in part.param_groups:
                group["lr"] = rate
            part.step()

    def moments(self) -> dict[str, Tensor]:
        """The state as "key/parameter" -> tensor."""
        return {
            f"{key}/{name}": torch.as_tensor(value)
            for name, parameter in self.named.items()
            for part, _ in self._parts
            for key, value in part.state.get(parameter, {}).items()
        }

    def set_moments(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Load a state from `moments`. Parameters that are missing in it, or belong to another optimiser there, keep
        their state."""
        for part, wanted in self._parts:
            held = {id(parameter) for group in part.param_groups for parameter in group["params"]}
            for name, parameter in self.named.items():
                if id(parameter) in held and all(f"{key}/{name}" in arrays for key in wanted):
                    state = {key: torch.from_numpy(np.array(arrays[f"{key}/{name}"])) for key in wanted}
                    part.state[parameter] = {
                        key: value if key == "step" else value.to(parameter.device) for key, value in state.items()
                    }
