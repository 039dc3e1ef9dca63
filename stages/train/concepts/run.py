"""`pumps train concepts` trains the networks that find and mend flawed frames, on segmented motions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from data_schemas.concepts import ConceptsReader
from data_schemas.errors import InputError, UsageError
from data_schemas.trainings import training_data
from stages.shared.concepts.clusters import needs_sklearn
from stages.shared.concepts.quality import fit_quality
from stages.shared.concepts.sequences import LEAST_FRAMES, ConceptSet, concept_set, placing_of
from stages.shared.contract import StageReport
from stages.shared.inference.anchor_chances import balanced_limit, frame_chances
from stages.shared.networks.concepts.reconstruction import MotionReconstructor
from stages.shared.networks.concepts.refiners import ConceptNetworks
from stages.shared.networks.layers.device import choose_device
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.training.loop import Trained, train
from stages.shared.training.stage import finish
from stages.train.concepts.config import Config
from stages.train.concepts.task import ConceptTask, ReconstructionTask

_MOST_CLIPS = 200  # of one action whose anchors the quality score is fitted to


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Train; then fit the quality score of each action to the features of its anchors.

    Raises: UsageError without scikit-learn, or if one of the actions has no anchor concepts; InputError for an
        artefact without anchor concepts, or of several rigs or rates.
    """
    check_artefact(config, "checkpoint")
    needs_sklearn()
    with ConceptsReader(config.concepts) as reader:
        progress.start("reading concepts")
        found = concept_set(reader, config.actions)
        missing = sorted(set(config.actions) - set(found.actions))
        if missing:
            raise UsageError(
                f"There are no anchor concepts of {', '.join(missing)}.", f"Take of {', '.join(found.actions)}."
            )
        if not found.of("train"):
            raise InputError(f"{config.concepts} holds no training clip of {', '.join(found.actions)}.")
        torch.manual_seed(config.seed)  # weights are drawn only here
        networks = new_networks(found, config.width, config.latent, config.method)
        device = choose_device(config.device)
        if isinstance(networks, MotionReconstructor):
            task = ReconstructionTask(config, networks, found, device)
        else:
            task = ConceptTask(config, networks, found, device)
        trained = train(task, config, progress=progress)
        limit = {}
        if trained.finished and isinstance(networks, ConceptNetworks):
            networks.load_state_dict({name: torch.from_numpy(value) for name, value in trained.weights.items()})
            trained = _with_quality(trained, networks, found, config)
            limit = {"anchor_limit": _anchor_limit(networks, found, config)}
        kept = {
            "network": "concepts",
            "settings": {"width": config.width, "latent": config.latent, "method": config.method},
            **limit,
            "actions": list(found.actions),
            "concepts": [int((found.action_of == action).sum()) for action in range(len(found.actions))],
            "body": {
                "names": list(found.body.names),
                "parents": found.body.parents.tolist(),
                "groups": found.body.groups.tolist(),
            },
            "fps": found.fps,
            "price": reader.price,
        }
        rows = [reader.row(each.clip) for each in found.of("train")]
        return finish(
            config, trained, stage="train-concepts", network=kept, data=training_data(rows), inputs=[reader.artefact]
        )


def new_networks(
    found: ConceptSet, width: int, latent: int, method: str = "splines"
) -> ConceptNetworks | MotionReconstructor:
    """Networks for the joints, actions and anchor concepts of a set, of a `Config.method`."""
    flat = torch.from_numpy(found.centres.reshape(len(found.centres), -1).astype(np.float32))
    action_of = torch.from_numpy(found.action_of.astype(np.int64))
    if method == "reconstruction":
        return MotionReconstructor(flat.shape[1], len(found.actions), width)
    splines = method == "splines"
    return ConceptNetworks(flat.shape[1], len(found.actions), width, latent, flat, action_of, splines=splines)


def _anchor_limit(networks: ConceptNetworks, found: ConceptSet, config: Config) -> float:
    """The chance above which a frame is an anchor: held-back clips then have as many as they were segmented into."""
    networks.eval()
    held_back = (found.of("val") or found.of("train"))[:_MOST_CLIPS]
    groups = found.body.groups
    chances = [
        frame_chances(networks.recogniser, each.positions.astype(np.float64), each.action, groups, config.window)[0]
        for each in held_back
    ]
    return balanced_limit(chances, sum(len(each.anchors) for each in held_back))


def _with_quality(trained: Trained, networks: ConceptNetworks, found: ConceptSet, config: Config) -> Trained:
    """The trained weights, with the mixture of each action's anchor features under `quality/`."""
    networks.eval()
    weights = dict(trained.weights)
    for action in range(len(found.actions)):
        mine = [each for each in found.of("train") if each.action == action][:_MOST_CLIPS]
        if not mine:
            continue
        features = [_anchor_features(networks, each.positions, each.anchors, action, found, config) for each in mine]
        quality = fit_quality(np.concatenate(features), config.flawed_share, config.seed)
        for name, array in quality.arrays().items():
            weights[f"quality/{action}/{name}"] = array
    return replace(trained, weights=weights)


def _anchor_features(
    networks: ConceptNetworks,
    positions: np.ndarray,
    anchors: np.ndarray,
    action: int,
    found: ConceptSet,
    config: Config,
) -> np.ndarray:
    """(A, D) features of a clip's anchors, from windows that follow each other; a last window of at most
    `LEAST_FRAMES` frames is left out. (`judged` averages over overlapping windows instead.)"""
    out = []
    device = next(networks.parameters()).device
    for start in range(0, max(len(positions) - LEAST_FRAMES, 1), config.window):
        part = positions[start : start + config.window].astype(np.float64)
        placed = placing_of(part, found.body.groups).put(part).reshape(1, len(part), -1)
        motion = torch.from_numpy(placed).float().to(device)
        seen = torch.ones(motion.shape[:2], dtype=torch.bool, device=device)
        with torch.no_grad():
            features, _ = networks.recogniser(motion, torch.tensor([action], device=device), seen)
        inside = anchors[(anchors >= start) & (anchors < start + len(part))] - start
        out.append(features[0, inside].cpu().numpy())
    return np.concatenate(out)
