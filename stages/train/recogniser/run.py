"""`pumps train recogniser` trains a network that recognises the action of a motion."""

from __future__ import annotations

import numpy as np
import torch

from data_schemas.concepts import ConceptsReader
from data_schemas.errors import InputError
from data_schemas.trainings import training_data
from stages.shared.concepts.sequences import concept_set
from stages.shared.contract import StageReport
from stages.shared.networks.concepts.action_recogniser import ActionRecogniser
from stages.shared.networks.layers.device import choose_device
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.statistics.generation import accuracy
from stages.shared.training.loop import train
from stages.shared.training.stage import finish
from stages.train.recogniser.config import Config
from stages.train.recogniser.task import ActionTask


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Train, and state the accuracy on the test clips.

    Raises: InputError for an artefact without anchor concepts, of several rigs or rates, or with fewer than two
        actions to tell apart.
    """
    check_artefact(config, "checkpoint")
    with ConceptsReader(config.concepts) as reader:
        progress.start("reading motions")
        found = concept_set(reader, config.actions)
        if len({each.action for each in found.of("train")}) < 2:
            raise InputError(f"{config.concepts} holds fewer than two actions to tell apart.", "Give more --actions.")
        torch.manual_seed(config.seed)  # weights are drawn only here
        network = ActionRecogniser(3 * len(found.body.names), len(found.actions), config.width)
        task = ActionTask(config, network, found, choose_device(config.device))
        trained = train(task, config, progress=progress)
        tested = None
        if trained.finished and found.of("test"):
            network.load_state_dict(
                {name: torch.from_numpy(np.array(value)) for name, value in trained.weights.items()}
            )
            batch = task.drawer().batch([(clip, 0) for clip in found.of("test")])
            with torch.no_grad():
                _, logits = network.eval()(batch.motion.to(task.device), batch.counts.to(task.device))
            tested = accuracy(logits.cpu().numpy(), batch.action.numpy())
        kept = {
            "network": "action-recogniser",
            "settings": {"width": config.width},
            "actions": list(found.actions),
            "joints": list(found.body.names),
            "fps": found.fps,
            "test_accuracy": tested,
        }
        rows = [reader.row(each.clip) for each in found.of("train")]
        report = finish(
            config,
            trained,
            stage="train-recogniser",
            network=kept,
            data=training_data(rows),
            inputs=[reader.artefact],
        )
    if tested is not None:
        report.lines.append(f"Accuracy on {len(found.of('test'))} test clips: {tested:.1%}.")
        report.figures["test_accuracy"] = tested
    return report
