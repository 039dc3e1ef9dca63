"""Networks that fill one skeleton's poses, in use: PC-MRL's interpolator (3.4), and the methods of Table 1."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import Artefact, open_artefact
from data_schemas.trainings import last_sentence
from stages.shared.inference.bounded_network import build_bounded
from stages.shared.inference.models import load_state
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.window_interpolation import interpolate_windows
from stages.shared.networks.inbetween.method import Method
from stages.shared.networks.inbetween.methods import method_class
from stages.shared.networks.inbetween.pose_space import PoseSpace
from stages.shared.networks.inbetween.windows import denoised_bones, filled_bones
from stages.shared.networks.layers.device import choose_device
from stages.shared.networks.layers.sizes import InterpolatorSizes, MethodSizes
from stages.shared.networks.pcmrl.pose_interpolator import PoseInterpolator, PoseWindows

_KINDS = ("pose-interpolator", "inbetween")


@dataclass(frozen=True)
class Interpolator:
    """A network in use. `trained` are the settings of its training, `trained_on` says on what."""

    network: PoseInterpolator | Method
    parents: list[int]
    groups: list[int]
    artefact: Artefact
    trained: dict[str, object]
    trained_on: str
    device: torch.device

    def check_hierarchy(self, parents: np.ndarray, groups: np.ndarray, what: str) -> None:
        """Raises InputError where bones (J,) are not those that the network was trained on."""
        same = list(parents) == self.parents and list(groups) == self.groups
        if not same:
            raise InputError(
                f"{self.artefact.path} interpolates {len(self.parents)} bones of another hierarchy than the "
                f"{len(parents)} of {what}.",
                "Train it on motions of that skeleton.",
            )

    def fill(self, heads: Tensor, rotations: Tensor, tails: Tensor, known: Tensor) -> tuple[Tensor, Tensor]:
        """Fill windows between their known frames; what stands in other frames is not read.

        Args:
            heads: (B, T, J, 3) metres. rotations: (B, T, J, 4) global, xyzw. tails: (B, J, 3). All at 30 fps.
            known: (B, T), the first frame always.

        Returns: heads (B, T, J, 3) and rotations (B, T, J, 4), on the CPU.
        """
        gate = known[..., None, None]
        heads = torch.where(gate, heads, 0.0)
        rotations = torch.where(gate, rotations, torch.tensor([0.0, 0.0, 0.0, 1.0]))
        parents = torch.tensor(self.parents).expand(len(heads), -1)
        base = interpolate_windows(heads, rotations, parents, known, rate_hz=MODEL_FPS)
        given, plain = (
            PoseWindows(*(part.to(self.device) for part in parts))
            for parts in ((heads, rotations, tails), (*base, tails))
        )
        known = known.to(self.device)
        with torch.no_grad():
            if isinstance(self.network, Method):
                one, other = ((each.heads, each.rotations) for each in (given, plain))
                made = filled_bones(self.network, one, other, known)
            else:
                times = torch.arange(float(known.shape[1]), device=self.device).unsqueeze(0)
                made = self.network(given, plain, known, times)
        return made[0].cpu(), made[1].cpu()

    @property
    def denoises(self) -> bool:
        """Whether the network is a prior that can be descended from noisy motion."""
        return isinstance(self.network, Method) and self.network.descends

    def denoise(self, heads: Tensor, rotations: Tensor) -> tuple[Tensor, Tensor]:
        """Noisy windows cleaned by a prior (`denoises`): heads (B, T, J, 3) metres, global rotations (B, T, J, 4)."""
        assert isinstance(self.network, Method)
        made = denoised_bones(self.network, (heads.to(self.device), rotations.to(self.device)))
        return made[0].cpu(), made[1].cpu()


def load_interpolator(path: str | Path, device: str = "auto") -> Interpolator:
    """The network of a checkpoint that `pumps train citl` or `pumps train baseline` wrote. Raises InputError where it
    is none."""
    artefact = open_artefact(path, "checkpoint")
    kept = read_checkpoint(artefact, optimiser=False)
    config = kept.config
    build, sizes = _building(config, path)
    network = build_bounded(build, sizes, kept.weights, path)
    load_state(network, kept.weights, path)
    chosen = choose_device(device)
    return Interpolator(
        network.to(chosen).eval(),
        list(config["parents"]),
        list(config["groups"]),
        artefact,
        dict(artefact.manifest.config),
        last_sentence(kept.trainings),
        chosen,
    )


def is_interpolator(config: Mapping[str, Any]) -> bool:
    """Whether a checkpoint's config is that of a network that fills one skeleton's poses."""
    return config.get("network") in _KINDS


def _building(config: Mapping[str, Any], path: str | Path) -> tuple[Callable[[], PoseInterpolator | Method], object]:
    """What builds the network of a config, and the sizes that it reads."""
    if not is_interpolator(config):
        raise InputError(
            f"{path} holds no interpolator of poses.",
            "Give the folder that `pumps train citl` or `pumps train baseline` wrote.",
        )
    sizes: Any
    if config["network"] == "pose-interpolator":
        sizes = config.get("interpolator")
        return lambda: PoseInterpolator(config["parents"], config["groups"], InterpolatorSizes(**sizes)), sizes
    try:
        method = method_class(str(config.get("method")))
    except UsageError as error:
        raise InputError(f"{path} holds a method that is not installed here. {error.message}", error.hint) from None
    sizes = config.get("sizes")
    return lambda: method(PoseSpace(config["parents"], config["groups"]), MethodSizes(**sizes)), sizes
