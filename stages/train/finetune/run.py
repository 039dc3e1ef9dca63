"""`pumps train finetune`: motions of one rig in, a network for one task on that rig out (PUMPS 5)."""

from __future__ import annotations

from typing import Any

import torch

from data_schemas.artefact import open_artefact
from data_schemas.errors import UsageError
from data_schemas.manifest import Artefact
from data_schemas.tpc import TpcReader
from stages.shared.contract import StageReport
from stages.shared.formats.rig_file import rig_of_file
from stages.shared.inference.models import load_weights
from stages.shared.networks.layers.device import choose_device
from stages.shared.networks.pumps.pose_trunk import PoseTrunk
from stages.shared.outputs import check_artefact
from stages.shared.pose_tasks.body_pose import outputs_of
from stages.shared.pose_tasks.pose_network import NETWORKS, OF_KEYPOINTS, SIZES, PoseNetwork
from stages.shared.pose_tasks.registry import task_named
from stages.shared.progress import SILENT, Progress
from stages.shared.training.loop import train
from stages.shared.training.pose_training import PoseTraining, rig_pools
from stages.shared.training.stage import data_of, finish
from stages.shared.weights.shipped import parts_of, weights_folder
from stages.train.finetune.config import SCRATCH, Config


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Train the network. The checkpoint holds the task, the rig and the scales of the features.

    Raises: InputError for a bad rig, bad weights or no motion of the rig, UsageError for an unknown task.
    """
    check_artefact(config, "checkpoint")
    rig = rig_of_file(config.skeleton, config.rest_frame)
    task = task_named(config.task, rig, config.corruption)
    torch.manual_seed(config.seed)  # weights are drawn only here; parameters have no other generator
    network, settings, sources = started_network(config, task.features, outputs_of(rig.body))
    network.from_root = settings["from_root"] = task.from_root
    with TpcReader(config.tpc) as reader:
        progress.start("reading windows")
        pool, held_back = rig_pools(reader, rig, config)
        weights = {"position": config.position_weight, "quaternion": config.quaternion_weight}
        device = choose_device(config.device)
        training = PoseTraining(config, task, network, pool, held_back, device, weights)
        trained = train(training, config, progress=progress)
        kept = {
            "network": "pose",
            "kind": config.network,
            "settings": settings,
            "task": config.task,  # the name by which it is found, also that of an entry point
            "corruption": task.corruption,
            "features": task.features,
            "rig": rig.plain(),
            "from": config.from_,
        }
        inputs = [reader.artefact, *sources]
        report = finish(config, trained, stage="train-finetune", network=kept, data=data_of(reader), inputs=inputs)
    return report.model_copy(update={"lines": [*(f"Note: {note}" for note in task.notes), *report.lines]})


def started_network(
    config: Config, features: int, outputs: int
) -> tuple[PoseNetwork, dict[str, Any], list[Artefact]]:
    """The network around the synthesiser of `from_` or a new one, its settings, and the artefacts it came from."""
    if config.network not in NETWORKS:
        raise UsageError(f"There is no network {config.network!r}.", f"Take one of {', '.join(NETWORKS)}.")
    if config.network in OF_KEYPOINTS and config.task != "estimate":
        others = ", ".join(kind for kind in NETWORKS if kind not in OF_KEYPOINTS)
        raise UsageError(
            f"The network {config.network} reads keypoints, for --task estimate.", f"Take one of {others}."
        )
    if config.network != "pumps":
        sizes: dict[str, Any] = dict(SIZES[config.network])
        return PoseNetwork(config.network, features, outputs, sizes), sizes, []
    if config.from_ == SCRATCH:
        settings = {"latent_width": config.latent_width, "synthesiser": config.synthesiser.model_dump()}
        return PoseNetwork("pumps", features, outputs, settings), settings, []
    models = load_weights(config.from_, "cpu", confidence=False)
    synthesiser = models.synthesiser
    settings = {"latent_width": synthesiser.latent_width, "synthesiser": synthesiser.sizes.model_dump()}
    network = PoseNetwork("pumps", features, outputs, settings)
    assert isinstance(network.inner, PoseTrunk)
    network.inner.synthesiser.load_state_dict(synthesiser.state_dict())
    _, lms = parts_of(weights_folder(config.from_))
    return network, settings, [open_artefact(lms, "checkpoint")]
