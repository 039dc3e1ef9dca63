"""A trained recogniser of actions in use: features and logits of motions."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from data_schemas.artefact import open_artefact
from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError
from data_schemas.manifest import Artefact
from stages.shared.inference.bounded_network import MOST_WINDOW, build_bounded, whole_setting
from stages.shared.inference.models import load_state
from stages.shared.networks.concepts.action_recogniser import ActionRecogniser
from stages.shared.networks.layers.device import choose_device

_BATCH = 256


@dataclass(frozen=True)
class RecogniserModel:
    """A trained recogniser. actions, joints: names; fps and window: rate and most frames of the motions that it
    reads; test_accuracy: on the held-out clips of its training, None where there were none."""

    network: ActionRecogniser
    actions: tuple[str, ...]
    joints: tuple[str, ...]
    fps: float
    window: int
    test_accuracy: float | None
    artefact: Artefact
    device: torch.device

    def recognised(self, motion: Tensor, counts: Tensor) -> tuple[np.ndarray, np.ndarray]:
        """Features (N, D) and logits (N, C) of motions (N, T, 3 J), each as seen from its first frame; counts: (N,)
        real frames."""
        found = []
        with torch.no_grad():
            for start in range(0, len(motion), _BATCH):
                part = slice(start, start + _BATCH)
                both = self.network(motion[part].to(self.device), counts[part].to(self.device))
                found.append([each.cpu().numpy() for each in both])
        features, logits = (np.concatenate(each) for each in zip(*found, strict=True))
        return features.astype(np.float64), logits


def load_recogniser(path: Path, device: str) -> RecogniserModel:
    """Read a checkpoint of `pumps train recogniser`. Raises InputError if it is another network's, or damaged."""
    artefact = open_artefact(path, "checkpoint")
    stored = read_checkpoint(artefact, optimiser=False)
    config = stored.config
    if config.get("network") != "action-recogniser":
        raise InputError(f"{path} holds no recogniser of actions.", "Give a checkpoint of `pumps train recogniser`.")
    actions, joints, fps = (config.get(name) for name in ("actions", "joints", "fps"))
    tested = config.get("test_accuracy")
    if not isinstance(actions, list) or not isinstance(joints, list):
        raise InputError(f"{path} is damaged: it does not say its actions and joints.", "Train it again.")
    if not isinstance(fps, int | float) or not 0 < fps < 1e6 or not isinstance(tested, float | int | None):
        raise InputError(f"{path} is damaged: it does not say its rate and accuracy as numbers.", "Train it again.")
    window = whole_setting(config, "window", MOST_WINDOW, path)
    settings = config.get("settings")
    network = build_bounded(
        lambda: ActionRecogniser(3 * len(joints), len(actions), settings["width"]),  # pyright: ignore
        settings, stored.weights, path,
    )  # fmt: skip
    load_state(network, stored.weights, path)
    where = choose_device(device)
    return RecogniserModel(
        network.to(where).eval(), tuple(map(str, actions)), tuple(map(str, joints)), float(fps), window,
        tested, artefact, where,
    )  # fmt: skip
