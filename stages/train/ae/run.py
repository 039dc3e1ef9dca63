"""`pumps train ae`: a `tpc` artefact in, the autoencoder's `checkpoint` out."""

from __future__ import annotations

from data_schemas.tpc import TpcReader
from stages.shared.contract import StageReport
from stages.shared.networks.layers.device import choose_device
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.training.loop import train
from stages.shared.training.stage import data_of, finish, window_pools
from stages.train.ae.config import Config
from stages.train.ae.task import AutoencoderTask


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Train the autoencoder of clouds.

    Raises: InputError for a bad tpc artefact, PumpsError if the loss is not a number.
    """
    check_artefact(config, "checkpoint")
    with TpcReader(config.tpc) as reader:
        progress.start("reading windows")
        device = choose_device(config.device)
        pool, held_back = window_pools(reader, config, device)
        task = AutoencoderTask(config, pool, held_back, device)
        trained = train(task, config, progress=progress)
        network = {
            "network": "autoencoder",
            "encoder": config.encoder.model_dump(),
            "decoder": config.decoder.model_dump(),
        }
        return finish(
            config, trained, stage="train-ae", network=network, data=data_of(reader), inputs=[reader.artefact]
        )
