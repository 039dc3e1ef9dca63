"""`pumps train generator` trains a network that generates motions of an action."""

from __future__ import annotations

import numpy as np
import torch

from data_schemas.concepts import ConceptsReader
from data_schemas.errors import InputError
from data_schemas.skeleton_text import plain_of_skeleton
from data_schemas.trainings import training_data
from stages.shared.concepts.plain_rig import rig_of_positions
from stages.shared.concepts.sequences import ConceptSet, concept_set
from stages.shared.contract import StageReport
from stages.shared.networks.concepts.action_generators import new_generator
from stages.shared.networks.layers.device import choose_device
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.training.loop import train
from stages.shared.training.stage import finish
from stages.train.generator.config import Config
from stages.train.generator.task import GeneratorTask

_RIG_CLIPS = 200  # whose bones are measured


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Train. The checkpoint also holds a rig of the training clips' mean bones, on which motions are written.

    Raises: InputError for an artefact without anchor concepts, of several rigs or rates, or without a training clip.
    """
    check_artefact(config, "checkpoint")
    with ConceptsReader(config.concepts) as reader:
        progress.start("reading motions")
        found = concept_set(reader, config.actions)
        clips = found.of("train")
        if not clips:
            raise InputError(f"{config.concepts} holds no training clip of {', '.join(found.actions)}.")
        settings = {
            "network": config.network, "width": config.width, "blocks": config.blocks, "latent": config.latent,
        }  # fmt: skip
        torch.manual_seed(config.seed)  # weights are drawn only here
        network = new_generator(features=3 * len(found.body.names), actions=len(found.actions), **settings)
        task = GeneratorTask(config, network, found, choose_device(config.device))
        trained = train(task, config, progress=progress)
        chosen = np.random.default_rng(config.seed).permutation(len(clips))[:_RIG_CLIPS]
        rig = rig_of_positions(found.body, [clips[at].positions for at in chosen])
        kept = {
            "network": "action-generator",
            "settings": settings,
            "actions": list(found.actions),
            "frames": _lengths(found, config.window),
            "skeleton": plain_of_skeleton(rig),
            "fps": found.fps,
        }
        rows = [reader.row(each.clip) for each in clips]
        return finish(
            config, trained, stage="train-generator", network=kept, data=training_data(rows), inputs=[reader.artefact]
        )


def _lengths(found: ConceptSet, window: int) -> list[int]:
    """The median length of each action's training windows, in frames; `window` for an action without clips."""
    counts = [
        [min(len(each.positions), window) for each in found.of("train") if each.action == action]
        for action in range(len(found.actions))
    ]
    return [int(np.median(each)) if each else window for each in counts]
