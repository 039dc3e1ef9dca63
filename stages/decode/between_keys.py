"""Latents or clouds onto the clips' own skeletons, between keyframes that are known."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Protocol

import numpy as np
import torch

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.clips import ClipRow
from data_schemas.errors import InputError
from data_schemas.latent import LatentReader
from data_schemas.manifest import Artefact
from data_schemas.motion import MotionReader, MotionWriter
from data_schemas.skeleton import Motion, Skeleton
from data_schemas.tpc import TpcReader
from stages.decode.clouds import chosen_rows, latents_of
from stages.decode.config import Config
from stages.shared.contract import StageReport
from stages.shared.inference.cloud_sources import GivenLatents
from stages.shared.inference.filling import fill_motion
from stages.shared.inference.keyframes import parse_keyframes
from stages.shared.inference.models import load_autoencoder
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.plain_interpolation import Glide
from stages.shared.kinematics.resampling import resample
from stages.shared.networks.layers.device import choose_device
from stages.shared.progress import Progress
from stages.shared.solve.following import follow_cloud

_HELD = Glide(0.0, 0.0)  # beyond the keys the pose stands still


class _Source(Protocol):
    """Clips to put onto their skeletons, by what is known of their motion."""

    artefacts: list[Artefact]
    rows: list[ClipRow]

    def fill(self, row: ClipRow, skeleton: Skeleton, motion: Motion, known: np.ndarray) -> Motion:
        """The motion with its unknown frames filled; only the known ones are read."""
        ...


def decode_between_keys(config: Config, progress: Progress) -> StageReport:
    """Write the motion artefact of all chosen clips that can be decoded, and tell of the others."""
    artefact = open_artefact(str(config.motion), "motion")
    skipped: dict[str, str] = {}
    frames = 0
    with _opened(config) as source, MotionReader(artefact) as motions:
        progress.start("decoding", len(source.rows))
        inputs = [*source.artefacts, artefact]
        with (
            write_artefact(config.output, "motion", stage="decode", config=config, inputs=inputs) as draft,
            MotionWriter(draft.folder) as writer,
        ):
            for row in source.rows:
                try:
                    frames += _add_motion(config, source, row, motions, writer)
                except InputError as error:
                    skipped[row.clip] = error.message
                progress.advance(note=row.clip)
            kept = len(source.rows) - len(skipped)
            if kept == 0:
                name, reason = next(iter(skipped.items()))
                raise InputError(
                    f"No clip could be decoded onto its skeleton; {name}: {reason}", "Check the keyframes."
                )
            draft.summary |= {"clips": kept, "frames": frames, "skipped": skipped}
    lines = [f"Decoded {frames} frames of {kept} clips onto their skeletons, keys {config.keyframes}."]
    lines += [f"Skipped {clip}: {reason}" for clip, reason in skipped.items()]
    return StageReport(
        output=config.output, lines=lines, figures={"clips": kept, "frames": frames, "skipped": skipped}
    )


def _add_motion(config: Config, source: _Source, row: ClipRow, motions: MotionReader, writer: MotionWriter) -> int:
    """Decode one clip between its motion's keyframes and store it; how many frames."""
    skeleton = motions.skeleton(motions.row(row.clip).skeleton)
    motion = resample(motions.motion(row.clip), row.fps)
    if motion.frames != row.frames or row.fps != MODEL_FPS:
        raise InputError(
            f"It has {row.frames} frames at {row.fps:g} fps; its motion has {motion.frames} at {MODEL_FPS:g} fps.",
            "Give the motion artefact that the latents or clouds were made from.",
        )
    known = np.zeros(motion.frames, bool)
    known[parse_keyframes(config.keyframes, motion.frames)] = True
    filled = source.fill(row, skeleton, motion, known)
    name = writer.add_skeleton(skeleton)
    writer.add_clip(replace(row, skeleton=name), filled)
    return motion.frames


@contextmanager
def _opened(config: Config) -> Iterator[_Source]:
    if config.tpc is not None:
        with TpcReader(config.tpc) as reader:
            yield _Clouds(reader, config)
        return
    with LatentReader(str(config.latent)) as latents:
        yield _Latents(latents, config)


class _Clouds:
    """Clouds of a tpc artefact: positions and groups alone, followed as they are."""

    def __init__(self, reader: TpcReader, config: Config):
        self.artefacts = [reader.artefact]
        self.rows = chosen_rows(reader.clips, config.splits, config.tpc)
        self._reader, self._config = reader, config
        self._device = choose_device(config.device)

    def fill(self, row: ClipRow, skeleton: Skeleton, motion: Motion, known: np.ndarray) -> Motion:
        points, groups = self._reader.points(row.clip, sigma_m=self._config.sigma_m)
        cloud, of_group = (torch.from_numpy(np.ascontiguousarray(part)).to(self._device) for part in (points, groups))
        return follow_cloud(skeleton, motion, known, cloud, of_group.long()).motion


class _Latents:
    """Latents: only what their decoding differs from that of the plain interpolation's moves points."""

    def __init__(self, reader: LatentReader, config: Config):
        self._autoencoder = load_autoencoder(str(config.ae), config.device)
        reader.check_encoder(self._autoencoder.digest)
        self.artefacts = [reader.artefact, open_artefact(str(config.ae), "checkpoint")]
        self.rows = chosen_rows(reader.clips, config.splits, config.latent)
        self._reader, self._config = reader, config

    def fill(self, row: ClipRow, skeleton: Skeleton, motion: Motion, known: np.ndarray) -> Motion:
        device = self._autoencoder.device
        latents, centroids, _ = latents_of(self._reader, row)
        source = GivenLatents(self._autoencoder, latents.to(device), centroids.to(device), _HELD)
        filled = fill_motion(
            skeleton, motion, known, source, points=self._config.points, seed=self._config.seed, device=device
        )
        return filled.motion
