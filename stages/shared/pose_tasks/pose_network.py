"""A network of any kind as tasks use it: features scaled, outputs added to the base pose."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import torch
from torch import Tensor, nn

from stages.shared.networks.denoisers.denoisers import DENOISERS, denoiser
from stages.shared.networks.denoisers.denoisers import SIZES as DENOISER_SIZES
from stages.shared.networks.layers.sizes import SynthesiserSizes
from stages.shared.networks.lifters.lifters import LIFTERS, lifter
from stages.shared.networks.lifters.lifters import SIZES as LIFTER_SIZES
from stages.shared.networks.pumps.pose_trunk import PoseTrunk
from stages.shared.pose_tasks.body_pose import BodyPose, pose_from_root, pose_of_outputs

_LEAST_SCALE = 1e-3  # of a feature; one that never changes is not blown up
_MOST_SCALED = 8.0  # standard deviations; what lies beyond is an outlier

# Kind of network -> what builds it from (features, outputs, its settings as plain data). Its module is called with
# (features (B, T, F), given (B, T), times (B or 1, T), valid (B, T) or None) and returns (B, T, outputs).
Builder = Callable[[int, int, Mapping[str, Any]], nn.Module]


def _pumps(features: int, outputs: int, settings: Mapping[str, Any]) -> nn.Module:
    return PoseTrunk(features, outputs, int(settings["latent_width"]), SynthesiserSizes(**settings["synthesiser"]))


NETWORKS: dict[str, Builder] = {
    "pumps": _pumps,
    **{kind: partial(lifter, kind) for kind in LIFTERS},
    **{kind: partial(denoiser, kind) for kind in DENOISERS},
}
SIZES: dict[str, dict[str, int]] = {**LIFTER_SIZES, **DENOISER_SIZES}  # of all kinds but pumps
OF_KEYPOINTS = frozenset(LIFTERS)  # these read the features of the task `estimate` alone


class PoseNetwork(nn.Module):
    """Scales the features by what they were in training, runs the network, and adds its outputs to the base pose.

    Args:
        kind: of `NETWORKS`. features, outputs: of a frame. settings: of the network, plain data.
    """

    mean: Tensor
    scale: Tensor

    def __init__(self, kind: str, features: int, outputs: int, settings: Mapping[str, Any]):
        super().__init__()
        self.inner = NETWORKS[kind](features, outputs, settings)
        self.from_root = bool(settings.get("from_root", False))  # `PoseTask.from_root`
        self.register_buffer("mean", torch.zeros(features))
        self.register_buffer("scale", torch.ones(features))

    def normalise_by(self, features: Tensor, given: Tensor) -> None:
        """Take mean and standard deviation from features (B, T, F) of the frames that are `given` (B, T)."""
        seen = features[given]
        self.mean.copy_(seen.mean(0))
        self.scale.copy_(seen.std(0).clamp_min(_LEAST_SCALE))

    def forward(
        self, features: Tensor, given: Tensor, base: BodyPose, times: Tensor, valid: Tensor | None = None
    ) -> BodyPose:
        """The pose (B, T); arguments as `TaskBatch` has them, times (B or 1, T) in model frames."""
        scaled = ((features - self.mean) / self.scale).clamp(-_MOST_SCALED, _MOST_SCALED)
        scaled = torch.where(given.unsqueeze(-1), scaled, 0.0)
        outputs = self.inner(scaled, given, times, valid).float()
        return pose_from_root(outputs, base) if self.from_root else pose_of_outputs(outputs, base)
