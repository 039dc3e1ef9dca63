"""Trained generators of motions by action in use."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from data_schemas.artefact import open_artefact
from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import Artefact
from data_schemas.skeleton import Motion, Skeleton
from data_schemas.skeleton_text import skeleton_of_plain
from stages.shared.concepts.plain_rig import motion_of_positions
from stages.shared.inference.bounded_network import MOST_WINDOW, build_bounded
from stages.shared.inference.models import load_state
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.networks.concepts.action_generators import ActionGenerator, new_generator
from stages.shared.networks.layers.device import choose_device

_BATCH = 64
_BATCH_FRAMES = 20_000  # bounds the memory of a batch of long motions
_MEND = "Give a checkpoint of `pumps train generator`."


@dataclass(frozen=True)
class GeneratorModel:
    """A trained generator. actions: their names; frames: the usual length of each; fps: of its motions; skeleton: the
    rig that they are written on; artefact: its checkpoint."""

    network: ActionGenerator
    actions: tuple[str, ...]
    frames: tuple[int, ...]
    fps: float
    skeleton: Skeleton
    artefact: Artefact
    device: torch.device

    def action(self, name: str) -> int:
        """The index of an action. Raises UsageError naming those there are."""
        if name not in self.actions:
            raise UsageError(f"No motions of {name!r} were learned.", f"Take one of {', '.join(self.actions)}.")
        return self.actions.index(name)


def load_generator(path: Path, device: str) -> GeneratorModel:
    """Read a checkpoint of `pumps train generator`. Raises InputError if it is another network's, or damaged."""
    artefact = open_artefact(path, "checkpoint")
    stored = read_checkpoint(artefact, optimiser=False)
    config = stored.config
    if config.get("network") != "action-generator":
        raise InputError(f"{path} holds no generator of motions.", _MEND)
    skeleton = skeleton_of_plain(config.get("skeleton"))
    actions, frames, fps = config.get("actions"), config.get("frames"), config.get("fps")
    if (
        not isinstance(actions, list)
        or not isinstance(frames, list)
        or not len(actions) == len(frames) > 0
        or not all(isinstance(each, int) and 0 < each <= MOST_WINDOW for each in frames)
    ):
        raise InputError(f"{path} is damaged: it does not say its actions and their lengths.", "Train it again.")
    if not isinstance(fps, int | float) or not 0 < fps < 1e6:
        raise InputError(f"{path} is damaged: it does not say its frame rate.", "Train it again.")
    settings = config.get("settings")
    network = build_bounded(
        lambda: new_generator(features=3 * skeleton.joints, actions=len(actions), **settings),  # pyright: ignore
        {key: value for key, value in settings.items() if key != "network"} if isinstance(settings, dict) else None,
        stored.weights,
        path,
    )
    load_state(network, stored.weights, path)
    where = choose_device(device)
    return GeneratorModel(
        network.to(where).eval(), tuple(map(str, actions)), tuple(frames), float(fps), skeleton, artefact, where
    )


def generated_motions(
    model: GeneratorModel, action: str, count: int, frames: int | None, seed: int
) -> Iterator[Motion]:
    """New motions of an action, on the model's rig, at its rate; the lowest joint of each comes to the ground.

    Only one batch of motions is in memory at a time.

    Args:
        frames: of each; None for the usual length of the action.
        seed: each motion depends only on the seed, the action and its own number, so that a higher `count` does not
            change the first ones.

    Raises: UsageError for an action that was not learned.
    """
    kind = model.action(action)
    length = model.frames[kind] if frames is None else frames
    batch = max(1, min(_BATCH, _BATCH_FRAMES // length))
    for start in range(0, count, batch):
        numbers = range(start, min(start + batch, count))
        shape = model.network.noise_shape(1, length)[1:]
        noise = [torch.randn(shape, generator=_generator(seed, kind, number)) for number in numbers]
        kinds = torch.full((len(numbers),), kind, device=model.device)
        with torch.no_grad():
            found = model.network.sample(kinds, length, torch.stack(noise).to(model.device))
        places = found.cpu().double().numpy().reshape(len(numbers) * length, -1, 3)
        whole = motion_of_positions(model.skeleton, places, model.fps)
        for at in range(len(numbers)):
            yield _on_ground(model.skeleton, whole.at(slice(at * length, (at + 1) * length)))


def _on_ground(skeleton: Skeleton, motion: Motion) -> Motion:
    """The motion moved up or down, so that its lowest joint is at height 0."""
    roots = motion.root_positions.copy()
    roots[:, 1] -= positions_of(skeleton, motion)[..., 1].min()
    return replace(motion, root_positions=roots)


def _generator(seed: int, kind: int, number: int) -> torch.Generator:
    word = np.random.SeedSequence((seed, kind, number)).generate_state(1, np.uint64)[0]
    return torch.Generator().manual_seed(int(word >> 1))
