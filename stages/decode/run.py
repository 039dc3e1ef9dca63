"""`pumps decode`: latents back into clouds, and onto the skeletons of motions whose keyframes are known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.errors import InputError, UsageError
from data_schemas.latent import ClipRow, LatentReader
from data_schemas.motion import MotionReader, MotionWriter
from data_schemas.tpc import TpcWriter
from stages.config import StageReport
from stages.decode.clouds import chosen_rows, group_counts, latents_of
from stages.decode.config import Config
from stages.decode.onto_rig import decode_onto_rig
from stages.inference.filling import fill_motion
from stages.inference.keyframes import parse_keyframes
from stages.inference.models import Autoencoder, load_autoencoder
from stages.kinematics.conventions import MODEL_FPS
from stages.kinematics.plain_interpolation import Glide
from stages.kinematics.resampling import resample
from stages.progress import SILENT, Progress

_HELD = Glide(0.0, 0.0)  # beyond the keys the pose stands still


@dataclass(frozen=True)
class _DecodingAlone:
    """The part of trained models that decoding needs."""

    autoencoder: Autoencoder
    glide: Glide = _HELD

    def synthesise(
        self, latents: Tensor, centroids: Tensor, known: Tensor, times: Tensor, base: tuple[Tensor, Tensor] | None
    ) -> tuple[Tensor, Tensor]:
        """The latents as they are: they come from outside."""
        return latents, centroids


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Decode the clips of `config.splits`.

    Raises: UsageError where the options do not belong together; InputError for bad artefacts, latents of another
        encoder, or where no clip can be decoded.
    """
    _check(config)
    if config.network is not None:
        return decode_onto_rig(config, progress)
    autoencoder = load_autoencoder(str(config.ae), config.device)
    with LatentReader(str(config.latent)) as reader:
        reader.check_encoder(autoencoder.digest)
        rows = chosen_rows(reader.clips, config.splits, config.latent)
        progress.start("decoding", len(rows))
        if config.motion is None:
            return _to_clouds(config, reader, rows, autoencoder, progress)
        return _to_motions(config, reader, rows, autoencoder, progress)


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
    if config.network is None and config.tpc is not None:
        raise UsageError(
            "Clouds are put onto the rig of a network.", "Give --network; `pumps train skeleton` makes one."
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


def _to_motions(
    config: Config, reader: LatentReader, rows: list[ClipRow], autoencoder: Autoencoder, progress: Progress
) -> StageReport:
    artefact = open_artefact(str(config.motion), "motion")
    inputs = [reader.artefact, open_artefact(str(config.ae), "checkpoint"), artefact]
    skipped: dict[str, str] = {}
    frames = 0
    with (
        MotionReader(artefact) as motions,
        write_artefact(config.output, "motion", stage="decode", config=config, inputs=inputs) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        for row in rows:
            try:
                frames += _add_motion(config, reader, row, autoencoder, motions, writer)
            except InputError as error:
                skipped[row.clip] = error.message
            progress.advance(note=row.clip)
        kept = len(rows) - len(skipped)
        if kept == 0:
            name, reason = next(iter(skipped.items()))
            raise InputError(f"No clip could be decoded onto its skeleton; {name}: {reason}", "Check the keyframes.")
        draft.summary |= {"clips": kept, "frames": frames, "skipped": skipped}
    lines = [f"Decoded {frames} frames of {kept} clips onto their skeletons, keys {config.keyframes}."]
    lines += [f"Skipped {clip}: {reason}" for clip, reason in skipped.items()]
    return StageReport(
        output=config.output, lines=lines, figures={"clips": kept, "frames": frames, "skipped": skipped}
    )


def _add_motion(
    config: Config,
    reader: LatentReader,
    row: ClipRow,
    autoencoder: Autoencoder,
    motions: MotionReader,
    writer: MotionWriter,
) -> int:
    """Decode one clip between its motion's keyframes and store it; how many frames."""
    source = motions.row(row.clip)
    skeleton = motions.skeleton(source.skeleton)
    motion = resample(motions.motion(row.clip), row.fps)
    if motion.frames != row.frames or row.fps != MODEL_FPS:
        raise InputError(
            f"It has {row.frames} latents at {row.fps:g} fps; its motion has {motion.frames} at {MODEL_FPS:g} fps.",
            "Give the motion artefact that the latents were made from.",
        )
    known = np.zeros(motion.frames, bool)
    known[parse_keyframes(config.keyframes, motion.frames)] = True
    latents, centroids, _ = latents_of(reader, row)
    filled = fill_motion(
        skeleton,
        motion,
        known,
        _DecodingAlone(autoencoder),
        cloud="latents",
        latents=(latents.to(autoencoder.device), centroids.to(autoencoder.device)),
        points=config.points,
        seed=config.seed,
        device=autoencoder.device,
    )
    name = writer.add_skeleton(skeleton)
    writer.add_clip(replace(row, skeleton=name), filled.motion)
    return motion.frames
