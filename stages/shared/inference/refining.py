"""Trained motion concepts in use: which anchors of a motion are flawed, and the motion refined (3.2)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch

from data_schemas.artefact import open_artefact
from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError, UsageError
from data_schemas.trainings import last_sentence
from stages.shared.concepts.body_positions import Body
from stages.shared.concepts.quality import AnchorQuality
from stages.shared.concepts.sequences import LEAST_FRAMES, placing_of, segment_arrays
from stages.shared.inference.anchor_chances import (
    PLAIN,
    chosen_anchors,
    frame_chances,
    placed,
    taper,
    windows_of,
)
from stages.shared.inference.bounded_network import build_bounded
from stages.shared.inference.models import load_state
from stages.shared.networks.concepts.reconstruction import MotionReconstructor
from stages.shared.networks.concepts.refiners import ConceptNetworks, Segments
from stages.shared.networks.layers.device import choose_device


@dataclass(frozen=True)
class ConceptModel:
    """Trained networks. actions: their names; names, parents, groups: of the body's joints; window: frames seen at
    once; quality: of each action's anchors; licences: of the training data; trained_on: what that was; anchor_limit:
    the chance above which a frame is an anchor."""

    trained: ConceptNetworks | MotionReconstructor
    actions: tuple[str, ...]
    names: tuple[str, ...]
    parents: np.ndarray
    groups: np.ndarray
    fps: float
    window: int
    quality: dict[int, AnchorQuality]
    licences: tuple[str, ...]
    trained_on: str
    device: torch.device
    anchor_limit: float = PLAIN

    @property
    def networks(self) -> ConceptNetworks:
        """The networks of concepts. Raises UsageError where motions are reconstructed without any."""
        if isinstance(self.trained, MotionReconstructor):
            raise UsageError(
                "These weights reconstruct whole motions and hold no concepts.",
                "Give weights that were trained with --method splines or --method frames.",
            )
        return self.trained

    def action(self, name: str) -> int:
        """The index of an action. Raises UsageError naming those there are."""
        if name not in self.actions:
            raise UsageError(f"No concepts of {name!r} were learned.", f"Take one of {', '.join(self.actions)}.")
        return self.actions.index(name)


@dataclass(frozen=True)
class Refinement:
    """A refined sequence.

    positions: (T, J, 3). anchors: (A,) frames; scores: (A,) log-likelihoods; flawed: (A,) bool; concepts: (A,) the
    concept within the action that a flawed anchor got, -1 for the others.
    """

    positions: np.ndarray
    anchors: np.ndarray
    scores: np.ndarray
    flawed: np.ndarray
    concepts: np.ndarray


def load_concepts(path: Path, device: str) -> ConceptModel:
    """Read a checkpoint of `pumps train concepts`. Raises InputError if it is another network's, or damaged."""
    artefact = open_artefact(path, "checkpoint")
    stored = read_checkpoint(artefact, optimiser=False)
    config = stored.config
    if not is_concepts(config):
        raise InputError(f"{path} holds no motion concepts.", "Give a checkpoint of `pumps train concepts`.")
    where = choose_device(device)
    weights = stored.weights
    body = _body_of(config, path)

    def build() -> ConceptNetworks | MotionReconstructor:
        settings, actions = config["settings"], len(config["actions"])
        if settings.get("method") == "reconstruction":
            return MotionReconstructor(3 * len(body["names"]), actions, settings["width"])
        concepts, action_of = (
            torch.from_numpy(np.array(weights[f"anchors.{name}"])) for name in ("concepts", "action_of")
        )
        return ConceptNetworks(
            concepts.shape[1],
            actions,
            settings["width"],
            settings["latent"],
            concepts,
            action_of.long(),
            splines=settings.get("method", "splines") == "splines",
        )

    networks = build_bounded(build, config.get("settings"), weights, path)
    load_state(networks, {name: value for name, value in weights.items() if not name.startswith("quality/")}, path)
    quality: dict[int, dict[str, np.ndarray]] = {}
    for name, value in stored.weights.items():
        if name.startswith("quality/"):
            _, action, part = name.split("/")
            quality.setdefault(int(action), {})[part] = value
    return ConceptModel(
        networks.to(where).eval(),
        tuple(config["actions"]),
        tuple(body["names"]),
        np.array(body["parents"], np.int32),
        np.array(body["groups"], np.int8),
        float(config["fps"]),
        int(config["window"]),
        {action: AnchorQuality.of_arrays(arrays) for action, arrays in quality.items()},
        tuple(artefact.manifest.licences),
        last_sentence(stored.trainings),
        where,
        float(config.get("anchor_limit", PLAIN)),
    )


def is_concepts(config: Mapping[str, Any]) -> bool:
    """Whether a checkpoint's config is that of motion concepts."""
    return config.get("network") == "concepts"


def kept_concepts(path: Path, device: str) -> ConceptModel:
    """As `load_concepts`, kept in memory for the next file, and loaded again where files have changed."""
    return _loaded(path, device, open_artefact(path, "checkpoint").manifest.digest)


@lru_cache(maxsize=2)
def _loaded(path: Path, device: str, digest: str) -> ConceptModel:
    """`digest` is that of the checkpoint's files."""
    return load_concepts(path, device)


def _body_of(config: Mapping[str, Any], path: Path) -> Mapping[str, Any]:
    """The part of a config that describes the body. Raises InputError where this or the rate and window lack."""
    body = config.get("body")
    whole = isinstance(body, dict) and {"names", "parents", "groups"} <= body.keys() and "actions" in config
    rates = (config.get("fps"), config.get("window"))
    if not whole or not all(isinstance(each, int | float) and each > 0 for each in rates):
        raise InputError(f"{path} is damaged: it does not describe its body, rate and window.", "Train it again.")
    return body  # pyright: ignore[reportReturnType]


def check_rig(model: ConceptModel, body: Body, name: str) -> None:
    """Raises InputError where the body of the motion `name` is another than the networks were trained on."""
    if body.names != model.names or (body.parents != model.parents).any():
        raise InputError(
            f"{name} is on another rig ({len(body.names)} joints, {body.names[0]} ...) than the "
            f"weights were trained on ({len(model.names)} joints, {model.names[0]} ...).",
            "Put it on that rig first: pumps retarget IN --to RIG.bvh -o OUT.bvh.",
        )


def refine(
    model: ConceptModel, positions: np.ndarray, action: str, *, only: str | None = None, seed: int = 0
) -> Refinement:
    """Refine a sequence.

    Args:
        positions: (T, J, 3) metres on the standard body, at the model's rate. only: "anchors" or "transitions".
        seed: of the transition generator's codes.

    Raises: UsageError for an action that was not learned; InputError for a sequence that is too short.
    """
    kind = model.action(action)
    if len(positions) < LEAST_FRAMES:
        raise InputError(
            f"The clip has {len(positions)} frames at {model.fps:g} a second, and {LEAST_FRAMES} are the fewest."
        )
    made = np.asarray(positions, np.float64).copy()
    if isinstance(model.trained, MotionReconstructor):
        if only is not None:
            raise UsageError(
                f"These weights reconstruct whole motions, and --only {only} needs concepts.", "Leave --only out."
            )
        ends, none = np.array([0, len(made) - 1]), np.zeros(2)
        return Refinement(_reconstructed(model, model.trained, made, kind), ends, none, none > 0, np.full(2, -1))
    anchors, scores, flawed = judged(model, made, kind)
    concepts = np.full(len(anchors), -1)
    if only != "transitions":
        generator = torch.Generator().manual_seed(seed)
        first = int(np.flatnonzero(model.networks.anchors.action_of.cpu().numpy() == kind)[0])
        for at in np.flatnonzero(flawed):
            found = _new_anchor(model, made, anchors, int(at), kind, generator)
            concepts[at] = found - first if found >= 0 else -1
    if only != "anchors":
        made = _new_transitions(model, made, anchors, kind)
    return Refinement(made, anchors, scores, flawed, concepts)


def judged(model: ConceptModel, positions: np.ndarray, kind: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Anchors (A,) of a sequence, the first and the last frame among them, their scores, and which are flawed."""
    chances, features = frame_chances(model.networks.recogniser, positions, kind, model.groups, model.window)
    anchors = chosen_anchors(chances, model.anchor_limit)
    if kind not in model.quality:
        return anchors, np.zeros(len(anchors)), np.zeros(len(anchors), bool)
    scores = model.quality[kind].scores(features[anchors])
    return anchors, scores, scores < model.quality[kind].threshold


def sampled_transition(
    model: ConceptModel,
    first: np.ndarray,
    last: np.ndarray,
    steps: int,
    generator: torch.Generator | None,
    *,
    fps: float | None = None,
) -> np.ndarray:
    """(steps + 1, J, 3) frames from one anchor (J, 3) to another; the ends are the anchors themselves.

    Args:
        generator: draws the code of the transition; None takes the most likely one, zero.
        fps: frames a second; by default the model's. The transition is a function of time, so any rate will do.
    """
    placing = placing_of(first[None], model.groups)
    ends = [torch.from_numpy(placing.put(pose).reshape(1, -1)).float().to(model.device) for pose in (first, last)]
    network = model.networks.generator
    code = torch.zeros(1, network.latent)
    if generator is not None:
        code = torch.randn(1, network.latent, generator=generator)
    seconds = torch.tensor([steps / (fps or model.fps)], device=model.device, dtype=torch.float32)
    times = torch.linspace(0, 1, steps + 1, device=model.device)[None]
    with torch.no_grad():
        frames = network.decoded(ends[0], ends[1], seconds, code.to(model.device), times)[0]
    made = placing.back(frames.cpu().double().numpy().reshape(steps + 1, -1, 3))
    share = np.linspace(0, 1, steps + 1)[:, None, None]
    return made + (1 - share) * (first - made[0]) + share * (last - made[-1])


def _new_anchor(
    model: ConceptModel, made: np.ndarray, anchors: np.ndarray, at: int, kind: int, generator: torch.Generator
) -> int:
    """Put a new pose at an anchor and new transitions beside it, in `made`. Returns its concept, over all actions."""
    frame, count = int(anchors[at]), len(made)
    before, after = int(anchors[max(at - 1, 0)]), int(anchors[min(at + 1, len(anchors) - 1)])
    size = min(max(model.window, after - before + 3), count)
    start = int(np.clip((before + after) // 2 - size // 2, 0, count - size))
    motion, placing = placed(made[start : start + size], model.groups, model.device)
    seen = _all(motion)
    seen[0, before - start + (at > 0) : after - start + (at == len(anchors) - 1)] = False
    if not seen.any():
        return -1
    with torch.no_grad():
        logits, pose = model.networks.anchors(
            motion, _kind(model, kind), seen, torch.tensor([frame - start], device=model.device)
        )
    made[frame] = placing.back(pose[0].cpu().double().numpy().reshape(-1, 3))
    for low, high in ((before, frame), (frame, after)):
        if high > low:
            made[low : high + 1] = sampled_transition(model, made[low], made[high], high - low, generator)
    return int(logits[0].argmax())


def _new_transitions(model: ConceptModel, positions: np.ndarray, anchors: np.ndarray, kind: int) -> np.ndarray:
    def made(motion: torch.Tensor, start: int) -> torch.Tensor:
        size = motion.shape[1]
        inside = anchors[(anchors > start) & (anchors < start + size - 1)] - start
        found = segment_arrays(np.array([0, *inside, size - 1]), size)
        arrays = (found.of_frame, found.times.astype(np.float32), found.first, found.last)
        segments = Segments(*(torch.from_numpy(each)[None].to(model.device) for each in arrays))
        return model.networks.transitions(motion, _kind(model, kind), _all(motion), segments)[0]

    return _in_windows(model, positions, made)


def _reconstructed(model: ConceptModel, network: MotionReconstructor, positions: np.ndarray, kind: int) -> np.ndarray:
    return _in_windows(model, positions, lambda motion, _: network(motion, _kind(model, kind), _all(motion)))


def _in_windows(
    model: ConceptModel, positions: np.ndarray, made: Callable[[torch.Tensor, int], torch.Tensor]
) -> np.ndarray:
    """What a network makes of a sequence (T, J, 3), window by window: `made` of a placed window (1, T, 3 J) and its
    first frame. Windows overlap, and their results are blended."""
    total, weight = np.zeros(positions.shape), np.zeros(len(positions))
    for start, size in windows_of(len(positions), model.window):
        motion, placing = placed(positions[start : start + size], model.groups, model.device)
        with torch.no_grad():
            whole = made(motion, start)
        share = taper(size)
        total[start : start + size] += share[:, None, None] * placing.back(
            whole[0].cpu().double().numpy().reshape(size, -1, 3)
        )
        weight[start : start + size] += share
    return total / weight[:, None, None]


def _kind(model: ConceptModel, kind: int) -> torch.Tensor:
    return torch.tensor([kind], device=model.device)


def _all(motion: torch.Tensor) -> torch.Tensor:
    return torch.ones(motion.shape[:2], dtype=torch.bool, device=motion.device)
