"""`pumps encode`: a `tpc` artefact and an autoencoder in, every frame's latent out."""

from __future__ import annotations

import numpy as np
import torch

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.latent import LatentWriter
from data_schemas.tpc import TpcReader
from stages.encode.config import Config
from stages.shared.contract import StageReport
from stages.shared.inference.models import load_autoencoder
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Encode every clip; the clip's own drawn points serve, so the same artefacts give the same latents.

    Raises: InputError for bad artefacts.
    """
    check_artefact(config, "latent")
    autoencoder = load_autoencoder(config.ae, config.device)
    frames = 0
    with TpcReader(config.tpc) as reader:
        inputs = [reader.artefact, open_artefact(config.ae, "checkpoint")]
        rows = config.share_of(reader.clips)
        progress.start("encoding", sum(row.frames for row in rows))
        with (
            write_artefact(
                config.output, "latent", stage="encode", config=config.model_dump(mode="json"), inputs=inputs
            ) as draft,
            LatentWriter(draft.folder, encoder_digest=autoencoder.digest) as writer,
        ):
            for row in rows:
                points, groups = reader.points(row.clip)
                if config.points:
                    points, groups = points[:, : config.points], groups[: config.points]
                latents, centroids = autoencoder.encode(torch.from_numpy(points), torch.from_numpy(groups).long())
                width = np.float16 if config.half else np.float32
                writer.add(row, latents.cpu().numpy().astype(width), centroids.cpu().numpy())
                frames += row.frames
                progress.advance(row.frames)
            draft.summary.update(clips=len(rows), frames=frames)
        return StageReport(
            output=config.output,
            lines=[
                f"Encoded {frames} frames of {len(rows)} clips, each into {autoencoder.encoder.latent_width} numbers."
            ],
            figures={"clips": len(rows), "frames": frames},
        )
