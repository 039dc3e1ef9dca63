"""`pumps train citl`: motions of one skeleton in, the checkpoint of an interpolator in its pose space out."""

from __future__ import annotations

from data_schemas.tpc import TpcReader
from stages.shared.contract import StageReport
from stages.shared.networks.layers.device import choose_device
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.training.loop import train
from stages.shared.training.stage import data_of, finish, window_pools
from stages.train.citl.config import Config
from stages.train.citl.task import InterpolatorTask


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Train the interpolator.

    Raises: InputError for a bad tpc artefact or one of several hierarchies, PumpsError if the loss is not a number.
    """
    check_artefact(config, "checkpoint")
    with TpcReader(config.tpc) as reader:
        progress.start("reading windows")
        pool, held_back = window_pools(reader, config)
        task = InterpolatorTask(config, pool, held_back, choose_device(config.device))
        trained = train(task, config, progress=progress)
        network = {
            "network": "pose-interpolator",
            "interpolator": config.network.model_dump(),
            "parents": task.parents.tolist(),
            "groups": task.groups.tolist(),
        }
        return finish(
            config, trained, stage="train-citl", network=network, data=data_of(reader), inputs=[reader.artefact]
        )
