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
from data_schemas.skeleton import BODY_GROUPS
from data_schemas.tpc import TpcWriter
from stages.config import StageReport
from stages.decode.config import Config
from stages.inference.filling import fill_motion
from stages.inference.keyframes import parse_keyframes
from stages.inference.models import Autoencoder, load_autoencoder
from stages.kinematics.conventions import MODEL_FPS
from stages.kinematics.resampling import resample
from stages.progress import SILENT, Progress

# Points of each body group where no skeleton says how long its bones are: shares of a human figure's bone lengths.
GROUP_SHARES = (0.16, 0.155, 0.155, 0.265, 0.265)


@dataclass(frozen=True)
class _DecodingAlone:
    """The part of trained models that decoding needs."""

    autoencoder: Autoencoder

    def synthesise(
        self, latents: Tensor, centroids: Tensor, known: Tensor, times: Tensor, base: tuple[Tensor, Tensor] | None
    ) -> tuple[Tensor, Tensor]:
        """The latents as they are: they come from outside."""
        return latents, centroids


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Decode the clips of `config.splits`.

    Raises: InputError for bad artefacts, latents of another encoder, or where no clip can be decoded.
    """
    if config.points < 1:
        raise UsageError(f"A cloud of {config.points} points is none.", "Give --points 1 or more.")
    autoencoder = load_autoencoder(config.ae, config.device)
    with LatentReader(config.latent) as reader:
        reader.check_encoder(autoencoder.digest)
        rows = [row for row in reader.clips if row.split in config.splits]
        if not rows:
            found = ", ".join(sorted({row.split for row in reader.clips})) or "none"
            raise InputError(
                f"{config.latent} has no clip in the splits {', '.join(config.splits)}; it has {found}.",
                "Give --splits.",
            )
        progress.start("decoding", len(rows))
        if config.motion is None:
            return _to_clouds(config, reader, rows, autoencoder, progress)
        return _to_motions(config, reader, rows, autoencoder, progress)


def group_counts(points: int) -> np.ndarray:
    """(P,) int64 body groups of `points` points, in the shares of a human figure, as whole numbers."""
    edges = np.rint(np.cumsum(GROUP_SHARES) / sum(GROUP_SHARES) * points).astype(np.int64)
    return np.repeat(np.arange(len(BODY_GROUPS)), np.diff(edges, prepend=0))


def _to_clouds(
    config: Config, reader: LatentReader, rows: list[ClipRow], autoencoder: Autoencoder, progress: Progress
) -> StageReport:
    groups = group_counts(config.points)
    noise = autoencoder.draw_noise(config.points, config.seed)
    inputs = [reader.artefact, open_artefact(config.ae, "checkpoint")]
    with (
        write_artefact(config.output, "tpc", stage="decode", config=config, inputs=inputs) as draft,
        TpcWriter(draft.folder) as writer,
    ):
        for row in rows:
            latents, centroids, times = _latents_of(reader, row)
            points = autoencoder.decode(latents, centroids, times, torch.from_numpy(groups), noise)
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
    inputs = [reader.artefact, open_artefact(config.ae, "checkpoint"), artefact]
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
    latents, centroids, _ = _latents_of(reader, row)
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


def _latents_of(reader: LatentReader, row: ClipRow) -> tuple[Tensor, Tensor, Tensor]:
    """Latents (T, D), centroids (T, 3) and times (T,) in model frames."""
    latents, centroids = reader.latents(row.clip)
    times = torch.arange(row.frames, dtype=torch.float64) * (MODEL_FPS / row.fps)
    return torch.from_numpy(latents), torch.from_numpy(centroids), times
