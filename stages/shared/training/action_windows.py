"""Windows of motions with a known action, each as seen from its first frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from stages.shared.concepts.sequences import ConceptSet, SegmentedSequence, placing_of
from stages.shared.training.task import RowRandom


@dataclass(frozen=True)
class ActionBatch:
    """motion (B, T, F) metres, each from its first frame; counts (B,) real frames; action (B,)."""

    motion: Tensor
    counts: Tensor
    action: Tensor


class ActionDrawer:
    """Draws windows: an action, a clip of it, a place in the clip."""

    def __init__(self, found: ConceptSet, window: int, clips: Sequence[SegmentedSequence] | None = None):
        """clips: to draw from; None for those of the split `train`."""
        self.groups, self.window = found.body.groups, window
        drawn = found.of("train") if clips is None else clips
        of_action = [[each for each in drawn if each.action == at] for at in range(len(found.actions))]
        self.by_action = [clips for clips in of_action if clips]

    def draw(self, rng: RowRandom) -> ActionBatch:
        chosen = []
        for row in rng.rows:
            clips = self.by_action[row.integers(len(self.by_action))]
            clip = clips[row.integers(len(clips))]
            chosen.append((clip, int(row.integers(max(len(clip.positions) - self.window, 0) + 1))))
        return self.batch(chosen)

    def batch(self, chosen: Sequence[tuple[SegmentedSequence, int]]) -> ActionBatch:
        """Windows of clips from these frames on."""
        parts = [(clip.positions[start : start + self.window], clip.action) for clip, start in chosen]
        return batch_of(parts, self.groups, self.window)


def windows_of(clips: Sequence[SegmentedSequence], window: int) -> list[tuple[SegmentedSequence, int]]:
    """The windows of clips, end to end: a clip and the first frame of each. A clip's last window is left out if it is
    shorter than half, unless it is the only one."""
    return [(clip, start) for clip in clips for start in range(0, max(len(clip.positions) - window // 2, 1), window)]


def batch_of(parts: Sequence[tuple[np.ndarray, int]], groups: np.ndarray, window: int) -> ActionBatch:
    """Motions as a batch.

    Args:
        parts: positions (T, J, 3) of at most `window` frames, metres on the standard body, and the action of each.
        groups: (J,) body groups of the joints.
    """
    rows, counts = [], []
    for positions, _ in parts:
        part = positions.astype(np.float64)
        flat = placing_of(part, groups).put(part).reshape(len(part), -1)
        rows.append(np.concatenate([flat, np.zeros((window - len(flat), flat.shape[1]))]))
        counts.append(len(flat))
    actions = torch.tensor([action for _, action in parts])
    return ActionBatch(torch.from_numpy(np.stack(rows)).float(), torch.tensor(counts), actions)
