"""`pumps train lms`: a `tpc` artefact and an autoencoder in, the synthesiser's `checkpoint` out."""

from __future__ import annotations

from data_schemas.artefact import open_artefact
from data_schemas.latent import LatentReader
from data_schemas.tpc import TpcReader
from stages.shared.contract import StageReport
from stages.shared.inference.models import load_autoencoder
from stages.shared.networks.layers.device import choose_device
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.synthesiser_training.task import SynthesiserTask
from stages.shared.training.loop import train
from stages.shared.training.stage import data_of, finish, window_pools
from stages.train.lms.config import Config


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Train the latent motion synthesiser with the frozen encoder.

    Raises: InputError for a bad artefact or latents of another encoder, PumpsError if the loss is not a number.
    """
    check_artefact(config, "checkpoint")
    autoencoder = load_autoencoder(config.ae, config.device)
    inputs = [open_artefact(config.ae, "checkpoint")]
    if config.latent is not None:
        with LatentReader(config.latent) as latents:
            latents.check_encoder(autoencoder.digest)
            inputs.append(latents.artefact)
    with TpcReader(config.tpc) as reader:
        progress.start("reading windows")
        device = choose_device(config.device)
        pool, held_back = window_pools(reader, config, device)
        task = SynthesiserTask(config, autoencoder, pool, held_back, device)
        trained = train(task, config, progress=progress)
        network = {
            "network": "synthesiser",
            "synthesiser": config.synthesiser.model_dump(),
            "encoder_digest": autoencoder.digest,
            "longest_gap": config.longest_gap,
        }
        return finish(
            config,
            trained,
            stage="train-lms",
            network=network,
            data=data_of(reader),
            inputs=[reader.artefact, *inputs],
        )
