"""`pumps encode`: a `tpc` artefact and an autoencoder in, every frame's latent out."""

from __future__ import annotations

from functools import lru_cache, partial
from pathlib import Path

import numpy as np
import torch

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.latent import LatentWriter
from data_schemas.tpc import TpcReader
from stages.encode.config import Config
from stages.shared.contract import StageReport
from stages.shared.inference.models import Autoencoder, load_autoencoder
from stages.shared.outputs import check_artefact
from stages.shared.pools import all_results, cluster_or_none
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
            with cluster_or_none(config.cluster) as pool:
                here = partial(_encoded, reader, autoencoder, config)
                elsewhere = partial(encode_clip, config, tuple(each.manifest.digest for each in inputs))
                clips = [row.clip for row in rows]
                encoded = all_results(pool, here if pool is None else elsewhere, clips)
                for row, (latents, centroids) in zip(rows, encoded, strict=True):
                    writer.add(row, latents, centroids)
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


def _encoded(reader: TpcReader, autoencoder: Autoencoder, config: Config, clip: str) -> tuple[np.ndarray, np.ndarray]:
    """Latents (T, D), in the width that is stored, and centroids (T, 3) of a clip."""
    points, groups = reader.points(clip)
    if config.points:
        points, groups = points[:, : config.points], groups[: config.points]
    latents, centroids = autoencoder.encode(torch.from_numpy(points), torch.from_numpy(groups).long())
    width = np.float16 if config.half else np.float32
    return latents.cpu().numpy().astype(width), centroids.cpu().numpy()


def encode_clip(config: Config, digests: tuple[str, ...], clip: str) -> tuple[np.ndarray, np.ndarray]:
    """`_encoded` in another process, which keeps the artefact and the autoencoder, of these digests, open for further
    clips."""
    return _encoded(*_opened(config.tpc, config.ae, config.device, digests), config, clip)


@lru_cache(maxsize=1)
def _opened(tpc: Path, ae: Path, device: str, digests: tuple[str, ...]) -> tuple[TpcReader, Autoencoder]:
    return TpcReader(tpc), load_autoencoder(ae, device)
