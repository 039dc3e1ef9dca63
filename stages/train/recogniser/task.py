"""Windows of labelled motions, and the cross entropy of their actions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from stages.shared.concepts.sequences import ConceptSet, SegmentedSequence, placing_of
from stages.shared.networks.concepts.action_recogniser import ActionRecogniser
from stages.shared.networks.layers.row_generator import RowGenerator
from stages.shared.training.task import RowRandom, TrainingTask
from stages.train.recogniser.config import Config


@dataclass(frozen=True)
class ActionBatch:
    """motion (B, T, F) metres, each from its first frame; counts (B,) real frames; action (B,)."""

    motion: Tensor
    counts: Tensor
    action: Tensor


class ActionDrawer:
    """Draws windows: an action, a clip of it, a place in the clip."""

    def __init__(self, found: ConceptSet, window: int):
        self.groups, self.window = found.body.groups, window
        of_action = [[each for each in found.of("train") if each.action == at] for at in range(len(found.actions))]
        self.by_action = [clips for clips in of_action if clips]

    def draw(self, rng: RowRandom) -> ActionBatch:
        chosen = []
        for row in rng.rows:
            clips = self.by_action[row.integers(len(self.by_action))]
            clip = clips[row.integers(len(clips))]
            chosen.append((clip, int(row.integers(max(len(clip.positions) - self.window, 0) + 1))))
        return self.batch(chosen)

    def batch(self, chosen: list[tuple[SegmentedSequence, int]]) -> ActionBatch:
        """Windows of clips from these frames on."""
        rows, counts = [], []
        for clip, start in chosen:
            part = clip.positions[start : start + self.window].astype(np.float64)
            flat = placing_of(part, self.groups).put(part).reshape(len(part), -1)
            rows.append(np.concatenate([flat, np.zeros((self.window - len(flat), flat.shape[1]))]))
            counts.append(len(flat))
        actions = [clip.action for clip, _ in chosen]
        return ActionBatch(torch.from_numpy(np.stack(rows)).float(), torch.tensor(counts), torch.tensor(actions))


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
