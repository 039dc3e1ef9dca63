"""A trained interpolator of one skeleton's pose space in use (CITL on FOQ, PC-MRL 3.4)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError
from data_schemas.manifest import Artefact, open_artefact
from data_schemas.trainings import last_sentence
from stages.shared.inference.bounded_network import build_bounded
from stages.shared.inference.models import load_state
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.window_interpolation import interpolate_windows
from stages.shared.networks.layers.device import choose_device
from stages.shared.networks.layers.sizes import InterpolatorSizes
from stages.shared.networks.pcmrl.pose_interpolator import PoseInterpolator, PoseWindows


@dataclass(frozen=True)
class Interpolator:
    """A network in use. `trained` are the settings of its training, `trained_on` says on what."""

    network: PoseInterpolator
    artefact: Artefact
    trained: dict[str, object]
    trained_on: str
    device: torch.device

    def check_hierarchy(self, parents: np.ndarray, groups: np.ndarray, what: str) -> None:
        """Raises InputError where bones (J,) are not those that the network was trained on."""
        same = list(parents) == self.network.parents and list(groups) == self.network.groups
        if not same:
            raise InputError(
                f"{self.artefact.path} interpolates {len(self.network.parents)} bones of another hierarchy than the "
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
        parents = torch.tensor(self.network.parents).expand(len(heads), -1)
        base = interpolate_windows(heads, rotations, parents, known, rate_hz=MODEL_FPS)
        given, plain = (
            PoseWindows(*(part.to(self.device) for part in parts))
            for parts in ((heads, rotations, tails), (*base, tails))
        )
        times = torch.arange(float(known.shape[1]), device=self.device).unsqueeze(0)
        with torch.inference_mode():
            made = self.network(given, plain, known.to(self.device), times)
        return made[0].cpu(), made[1].cpu()


def load_interpolator(path: str | Path, device: str = "auto") -> Interpolator:
    """The network of a checkpoint that `pumps train citl` wrote. Raises InputError where it is none."""
    artefact = open_artefact(path, "checkpoint")
    kept = read_checkpoint(artefact, optimiser=False)
    if kept.config.get("network") != "pose-interpolator":
        raise InputError(f"{path} holds no interpolator of poses.", "Give the folder that `pumps train citl` wrote.")
    network = build_bounded(
        lambda: PoseInterpolator(
            kept.config["parents"], kept.config["groups"], InterpolatorSizes(**kept.config["interpolator"])
        ),
        kept.config.get("interpolator"),
        kept.weights,
        path,
    )
    load_state(network, kept.weights, path)
    chosen = choose_device(device)
    return Interpolator(
        network.to(chosen).eval(),
        artefact,
        dict(artefact.manifest.config),
        last_sentence(kept.trainings),
        chosen,
    )
