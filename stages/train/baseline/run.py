"""`pumps train baseline`: motions of one skeleton in, the checkpoint of another method of filling out."""

from __future__ import annotations

from data_schemas.tpc import TpcReader
from stages.shared.contract import StageReport
from stages.shared.networks.inbetween.methods import method_class
from stages.shared.networks.layers.device import choose_device
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.training.loop import train
from stages.shared.training.stage import data_of, finish, window_pools
from stages.train.baseline.config import Config
from stages.train.baseline.task import BaselineTask


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Train the method.

    Raises: InputError for a bad tpc artefact or one of several hierarchies, PumpsError if the loss is not a number.
    """
    check_artefact(config, "checkpoint")
    method = method_class(config.method)
    rate = config.learning_rate or method.PAPER.learning_rate
    config = config.model_copy(update={"learning_rate": rate, "network": config.network.over(method.PAPER.sizes)})
    with TpcReader(config.tpc) as reader:
        progress.start("reading windows")
        pool, held_back = window_pools(reader, config)
        task = BaselineTask(config, method, pool, held_back, choose_device(config.device))
        trained = train(task, config, progress=progress)
        network = {
            "network": "inbetween",
            "method": config.method,
            "sizes": config.network.model_dump(),
            "parents": task.networks.space.parents.tolist(),
            "groups": list(task.networks.space.groups),
        }
        return finish(
            config, trained, stage="train-baseline", network=network, data=data_of(reader), inputs=[reader.artefact]
        )
