"""`pumps decode`: latents into clouds; latents or clouds onto skeletons whose keyframes are known, or onto a rig."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.errors import UsageError
from data_schemas.latent import ClipRow, LatentReader
from data_schemas.tpc import TpcWriter
from stages.decode.between_keys import decode_between_keys
from stages.decode.clouds import chosen_rows, group_counts, latents_of
from stages.decode.config import Config
from stages.decode.onto_rig import decode_onto_rig
from stages.shared.contract import StageReport
from stages.shared.inference.models import Autoencoder, load_autoencoder
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Decode the clips of `config.splits`.

    Raises: UsageError where the options do not belong together; InputError for bad artefacts, latents of another
        encoder, or where no clip can be decoded.
    """
    _check(config)
    check_artefact(config, "tpc" if config.network is None and config.motion is None else "motion")
    if config.network is not None:
        return decode_onto_rig(config, progress)
    if config.motion is not None:
        return decode_between_keys(config, progress)
    autoencoder = load_autoencoder(str(config.ae), config.device)
    with LatentReader(str(config.latent)) as reader:
        reader.check_encoder(autoencoder.digest)
        rows = chosen_rows(reader.clips, config.splits, config.latent)
        progress.start("decoding", len(rows))
        return _to_clouds(config, reader, rows, autoencoder, progress)


def _check(config: Config) -> None:
    if config.points < 1:
        raise UsageError(f"A cloud of {config.points} points is none.", "Give --points 1 or more.")
    if (config.latent is None) == (config.tpc is None):
        raise UsageError("Either latents or clouds are decoded.", "Give --latent with --ae, or --tpc.")
    if (config.latent is None) != (config.ae is None):
        raise UsageError("Latents are decoded by the autoencoder that made them.", "Give both --latent and --ae.")
    if config.network is not None and (config.motion is not None or config.method == "solve"):
        raise UsageError(
            "A network needs no keyframes, and the method solve no network.",
            "Leave --network away, or --motion and --method solve.",
        )
    if config.network is None and config.method in ("network", "both"):
        raise UsageError(f"The method {config.method} needs the network of a rig.", "Give --network.")
    if config.network is None and config.tpc is not None and config.motion is None:
        raise UsageError(
            "Clouds are put onto skeletons whose keyframes are known, or onto the rig of a network.",
            "Give --motion with --keyframes, or --network; `pumps train skeleton` makes one.",
        )


def _to_clouds(
    config: Config, reader: LatentReader, rows: list[ClipRow], autoencoder: Autoencoder, progress: Progress
) -> StageReport:
    groups = group_counts(config.points)
    noise = autoencoder.draw_noise(config.points, config.seed)
    inputs = [reader.artefact, open_artefact(str(config.ae), "checkpoint")]
    with (
        write_artefact(config.output, "tpc", stage="decode", config=config, inputs=inputs) as draft,
        TpcWriter(draft.folder) as writer,
    ):
        for row in rows:
            points = autoencoder.decode(*latents_of(reader, row), torch.from_numpy(groups), noise)
            writer.add_dense(replace(row, skeleton=""), points.cpu().numpy(), groups.astype(np.int8))
            progress.advance(note=row.clip)
        frames = sum(row.frames for row in rows)
        draft.summary |= {"clips": len(rows), "frames": frames, "points": config.points}
    line = f"Decoded {frames} frames of {len(rows)} clips into clouds of {config.points} points."
    return StageReport(
        output=config.output, lines=[line], figures={"clips": len(rows), "frames": frames, "points": config.points}
    )
