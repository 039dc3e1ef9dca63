"""Where the anchors of a sequence are, from the chances that the recogniser gives to its frames (3.2.1).

The paper does not say how high the chance of an anchor is. An anchor's frame is known to a few frames only, so its
chance is spread over them, and a network that knows little gives every frame the share of anchors among all frames,
about 0.1. With a limit of 0.5 it then finds no anchor at all. The limit is therefore chosen after the training, where
held-back clips have as many anchors as there are.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from stages.shared.concepts.sequences import Placing, placing_of
from stages.shared.networks.concepts.refiners import AnchorRecogniser

APART = 3  # frames between two anchors, at least
PLAIN = 0.5  # the limit of checkpoints that state none
_LIMITS = np.arange(1, 100) / 100


def frame_chances(
    recogniser: AnchorRecogniser, positions: np.ndarray, kind: int, groups: np.ndarray, window: int
) -> tuple[np.ndarray, np.ndarray]:
    """Chances (T,) that each frame is an anchor, and features (T, D): means over windows that overlap by half.

    Args:
        positions: (T, J, 3) metres on the standard body. kind: index of the action. groups: of the body's joints.
    """
    count, width = len(positions), recogniser.encoder.width
    chances, features, weight = np.zeros(count), np.zeros((count, width)), np.zeros(count)
    device = next(recogniser.parameters()).device
    for start, size in windows_of(count, window):
        motion = placed(positions[start : start + size], groups, device)[0]
        with torch.no_grad():
            seen = torch.ones(motion.shape[:2], dtype=torch.bool, device=device)
            found, logits = recogniser(motion, torch.tensor([kind], device=device), seen)
        part, share = slice(start, start + size), taper(size)
        chances[part] += share * logits[0].sigmoid().cpu().numpy()
        features[part] += share[:, None] * found[0].cpu().numpy()
        weight[part] += share
    return chances / weight, features / weight[:, None]


def chosen_anchors(chances: np.ndarray, limit: float) -> np.ndarray:
    """Anchors (A,): the first and the last frame, and those of the highest chance around them, above the limit."""
    count, anchors = len(chances), [0]
    for frame in range(1, count - 1):
        near = chances[max(frame - APART, 1) : min(frame + APART + 1, count - 1)]
        apart = min(frame - anchors[-1], count - 1 - frame)
        if apart >= APART and chances[frame] > limit and chances[frame] == near.max():
            anchors.append(frame)
    return np.array([*anchors, count - 1])


def balanced_limit(chances: Sequence[np.ndarray], anchors: int) -> float:
    """The highest limit at which at least as many anchors are found in sequences as they have, ends included; the
    lowest one, 0.01, if none finds so many.

    Args:
        chances: (T,) of each sequence. anchors: of all of them.
    """
    found = np.array([sum(len(chosen_anchors(each, limit)) for each in chances) for limit in _LIMITS])
    enough = np.flatnonzero(found >= anchors)
    return float(_LIMITS[enough[-1]]) if len(enough) else float(_LIMITS[0])


def placed(positions: np.ndarray, groups: np.ndarray, device: torch.device) -> tuple[torch.Tensor, Placing]:
    """A sequence (T, J, 3) as the networks read it, (1, T, 3 J), and its placing."""
    placing = placing_of(positions, groups)
    return torch.from_numpy(placing.put(positions).reshape(1, len(positions), -1)).float().to(device), placing


def windows_of(frames: int, window: int) -> list[tuple[int, int]]:
    """Starts and sizes of windows that overlap by half and cover a sequence."""
    if frames <= window:
        return [(0, frames)]
    starts = [*range(0, frames - window, max(window // 2, 1)), frames - window]
    return [(start, window) for start in starts]


def taper(size: int) -> np.ndarray:
    """(T,) weights of a window's frames where windows overlap: highest in the middle, above 0 at the ends."""
    return 1.0 - np.abs(np.linspace(-1, 1, size)) * 0.98
