"""The interface of a task in pose space (PUMPS 5): what a network sees of clean windows of one rig, and shall return.

A new task is a subclass of `PoseTask` with `features` and `draw`, named in `registry.py` or by an entry point.
Training, loss, validation and checkpoints are the same for all (`stages.shared.training.pose_training`), and
`pumps measure task` makes its table. docs/training.md shows a whole task.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from data_schemas.errors import UsageError
from stages.shared.kinematics.rotations import aligned_signs, turns_between
from stages.shared.pointcloud.rig import Rig
from stages.shared.pose_tasks.body_pose import BodyPose

_LEAST = 1e-10  # under the roots, so that the slope is finite where prediction equals truth


@dataclass(frozen=True)
class TaskBatch:
    """Windows as a task gives them to a network.

    features: (B, T, F) float32, what the network sees of each frame, finite.
    given:    (B, T) True where a frame holds any input; at least one in every row. Features elsewhere are not read.
    base:     the pose to which the network's outputs are added, such as the input itself or the rest pose.
    target:   the pose to return, in the same frame of reference as the base.
    valid:    (B, T) True for real frames, False for padding.
    """

    features: Tensor
    given: Tensor
    base: BodyPose
    target: BodyPose
    valid: Tensor

    def to(self, device: torch.device) -> TaskBatch:
        parts = (self.features, self.given, self.base, self.target, self.valid)
        return TaskBatch(*(part.to(device) for part in parts))  # pyright: ignore[reportArgumentType]


class PoseTask(ABC):
    """One task on one rig.

    name:        as `--task` has it.
    corruptions: names of the ways in which inputs may be worse than the truth, the paper's first.
    from_root:   whether the network's rotations are relative to the root's (`body_pose.pose_from_root`).

    Raises: UsageError for a corruption that the task does not have.
    """

    name: ClassVar[str]
    corruptions: ClassVar[tuple[str, ...]]
    from_root: ClassVar[bool] = False

    def __init__(self, rig: Rig, corruption: str | None = None):
        corruption = self.corruptions[0] if corruption is None else corruption
        if corruption not in self.corruptions:
            raise UsageError(
                f"The task {self.name} has no corruption {corruption!r}.",
                f"Take one of {', '.join(self.corruptions)}.",
            )
        self.rig, self.corruption = rig, corruption

    @property
    def notes(self) -> list[str]:
        """What a user should know of this task on this rig."""
        return []

    @property
    @abstractmethod
    def features(self) -> int:
        """Number of features of a frame."""

    @abstractmethod
    def draw(self, clean: BodyPose, valid: Tensor, rows: Sequence[np.random.Generator]) -> TaskBatch:
        """A batch of clean windows, each corrupted by its own generator only, so that batches can be split.

        Args:
            clean: B windows of T frames at 30 frames a second. valid: (B, T).
        """

    def errors(self, made: BodyPose, batch: TaskBatch) -> dict[str, Tensor]:
        """The terms of the loss, scalars: joint-wise L2 of positions (metres) and of quaternions, means over real
        frames."""
        body = self.rig.body
        apart = made.heads(body) - batch.target.heads(body)
        turned = aligned_signs(made.rotations, batch.target.rotations) - batch.target.rotations
        return {"position": mean_norm(apart, batch.valid), "quaternion": mean_norm(turned, batch.valid)}

    def measures(self, made: BodyPose, batch: TaskBatch) -> dict[str, float]:
        """What validation and `pumps measure task` report; the first selects the best weights. `mpjpe_mm`;
        `mpjve_mm`, mm/frame; `acceleration_mm`, mm/frame^2; `mpjae_deg`, degrees."""
        body = self.rig.body
        apart = made.heads(body) - batch.target.heads(body)
        steps = apart[:, 1:] - apart[:, :-1]
        turns = turns_between(batch.target.rotations, made.rotations)
        return {
            "mpjpe_mm": 1000 * float(mean_norm(apart, batch.valid)),
            "mpjve_mm": 1000 * float(mean_norm(steps, batch.valid[:, 1:])),
            "acceleration_mm": 1000 * float(mean_norm(steps[:, 1:] - steps[:, :-1], batch.valid[:, 2:])),
            "mpjae_deg": math.degrees(float(mean_norm(turns, batch.valid))),
        }


def mean_norm(values: Tensor, valid: Tensor) -> Tensor:
    """Mean over the joints of real frames of the norms of values (B, T, J, C); valid (B, T)."""
    norms = (values.float().square().sum(-1) + _LEAST).sqrt().mean(-1)
    return (norms * valid).sum() / valid.sum().clamp_min(1)
