"""`pumps train denoiser`: a `tpc` artefact of any rigs and trained weights in, a denoiser's `checkpoint` out."""

from __future__ import annotations

from data_schemas.artefact import open_artefact
from data_schemas.tpc import TpcReader
from stages.shared.contract import StageReport
from stages.shared.inference.models import load_weights
from stages.shared.networks.layers.device import choose_device
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.training.loop import train
from stages.shared.training.stage import data_of, finish, window_pools
from stages.shared.weights.shipped import parts_of, weights_folder
from stages.train.denoiser.config import Config
from stages.train.denoiser.task import DenoiserTask


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Train the denoiser with the frozen autoencoder. The checkpoint names the autoencoder by its digest.

    Raises: InputError for a bad artefact or bad weights, PumpsError if the loss is not a number.
    """
    check_artefact(config, "checkpoint")
    models = load_weights(config.from_, config.device, confidence=False)
    inputs = [open_artefact(part, "checkpoint") for part in parts_of(weights_folder(config.from_))]
    with TpcReader(config.tpc) as reader:
        progress.start("reading windows")
        device = choose_device(config.device)
        pool, held_back = window_pools(reader, config)
        task = DenoiserTask(config, models, pool, held_back, device)
        trained = train(task, config, progress=progress)
        network = {
            "network": "denoiser",
            "synthesiser": models.synthesiser.sizes.model_dump(),
            "encoder_digest": models.autoencoder.digest,
            "start": config.start,
            "noises": list(config.noises),
        }
        return finish(
            config,
            trained,
            stage="train-denoiser",
            network=network,
            data=data_of(reader),
            inputs=[reader.artefact, *inputs],
        )
