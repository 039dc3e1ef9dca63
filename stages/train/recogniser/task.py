"""The cross entropy of the actions of windows of labelled motions."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from stages.shared.concepts.sequences import ConceptSet
from stages.shared.networks.concepts.action_recogniser import ActionRecogniser
from stages.shared.networks.layers.row_generator import RowGenerator
from stages.shared.training.action_windows import ActionBatch, ActionDrawer
from stages.shared.training.task import TrainingTask
from stages.train.recogniser.config import Config


class ActionTask(TrainingTask[ActionRecogniser]):
    """Training on clips of the split `train`; validation on one window of each clip of `val`, or of `train` where
    there is none: the accuracy is stated on `test`."""

    def __init__(self, config: Config, network: ActionRecogniser, found: ConceptSet, device: torch.device):
        self.networks, self.device = network.to(device), device
        self._drawer = ActionDrawer(found, config.window)
        held_back = found.of("val") or found.of("train")
        self.held_back = self._drawer.batch([(clip, 0) for clip in held_back])

    def drawer(self, *, elsewhere: bool = False) -> ActionDrawer:
        return self._drawer

    def loss(self, batch: ActionBatch, generator: RowGenerator) -> tuple[Tensor, dict[str, Tensor]]:
        entropy, accuracy = self._figures(batch)
        return entropy, {"accuracy": accuracy}

    def validate(self) -> dict[str, float]:
        entropy, accuracy = self._figures(self.held_back)
        return {"entropy": float(entropy), "accuracy": float(accuracy)}

    def _figures(self, batch: ActionBatch) -> tuple[Tensor, Tensor]:
        action = batch.action.to(self.device)
        _, logits = self.networks(batch.motion.to(self.device), batch.counts.to(self.device))
        return F.cross_entropy(logits, action), (logits.argmax(1) == action).float().mean()
