"""`pumps train skeleton`: clouds of any skeletons in, a network that puts their motion on one rig out."""

from __future__ import annotations

from contextlib import ExitStack

from data_schemas.errors import UsageError
from data_schemas.tpc import TpcReader
from stages.shared.contract import StageReport
from stages.shared.formats.rig_file import rig_of_file
from stages.shared.networks.layers.device import choose_device
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.training.loop import train
from stages.shared.training.stage import data_of, finish
from stages.train.skeleton.config import Config
from stages.train.skeleton.sources import pools_of
from stages.train.skeleton.task import SkeletonTask


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Train the network. The checkpoint contains the rig, so that its output can be written without the rig's file.

    Raises: InputError for a bad rig or tpc artefact, PumpsError if the loss is not a number.
    """
    check_artefact(config, "checkpoint")
    if config.size_min > config.size_max:
        raise UsageError(f"size_min {config.size_min} is above size_max {config.size_max}.", "Exchange them.")
    if not config.tpc:
        raise UsageError("There is nothing to learn from.", "Give --tpc, once or more.")
    device = choose_device(config.device)
    rig = rig_of_file(config.skeleton, config.rest_frame)
    with ExitStack() as stack:
        readers = [stack.enter_context(TpcReader(path)) for path in config.tpc]
        progress.start("reading windows")
        pool, held_back = pools_of(readers, config)
        task = SkeletonTask(config, rig, pool, held_back, device)
        trained = train(task, config, progress=progress)
        network = {
            "network": "skeleton",
            "encoder": config.encoder.model_dump(),
            "skeleton": config.network.model_dump(),
            "rig": rig.plain(),
        }
        inputs = [reader.artefact for reader in readers]
        return finish(config, trained, stage="train-skeleton", network=network, data=data_of(*readers), inputs=inputs)
