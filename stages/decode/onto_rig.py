"""Clouds of any skeletons, or of latents, onto the one rig that a network was trained for."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Protocol

import numpy as np
import torch

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.clips import ClipRow
from data_schemas.latent import LatentReader
from data_schemas.manifest import Artefact
from data_schemas.motion import MotionWriter
from data_schemas.tpc import TpcReader
from stages.decode.clouds import chosen_rows, group_counts, latents_of
from stages.decode.config import Config
from stages.shared.contract import StageReport
from stages.shared.inference.models import load_autoencoder
from stages.shared.inference.skeleton_decoding import decode_cloud, load_rig_network, solve_from_network
from stages.shared.progress import Progress


class _Clouds(Protocol):
    """Clouds by clip."""

    artefacts: list[Artefact]
    rows: list[ClipRow]

    def of(self, row: ClipRow) -> tuple[np.ndarray, np.ndarray]:
        """Points (T, P, 3) metres and body groups (P,)."""
        ...


def decode_onto_rig(config: Config, progress: Progress) -> StageReport:
    """Write the motion artefact of all chosen clips on the network's rig, at the clouds' own rate."""
    network = load_rig_network(str(config.network), config.device)
    method = config.method or "network"
    decode = solve_from_network if method == "both" else decode_cloud
    frames, seconds = 0, 0.0
    with _opened(config) as clouds:
        inputs = [*clouds.artefacts, open_artefact(str(config.network), "checkpoint")]
        progress.start("decoding", len(clouds.rows))
        with (
            write_artefact(config.output, "motion", stage="decode", config=config, inputs=inputs) as draft,
            MotionWriter(draft.folder) as writer,
        ):
            name = writer.add_skeleton(network.rig.skeleton)
            for row in clouds.rows:
                cloud = clouds.of(row)
                began = time.perf_counter()
                motion = decode(network, *cloud, row.fps)
                seconds += time.perf_counter() - began
                writer.add_clip(replace(row, skeleton=name), motion)
                frames += row.frames
                progress.advance(note=row.clip)
            draft.summary |= {"clips": len(clouds.rows), "frames": frames, "method": method}
    line = (
        f"Decoded {frames} frames of {len(clouds.rows)} clips onto the network's rig, method {method}, "
        f"{frames / max(seconds, 1e-9):.0f} frames a second from clouds to motion."
    )
    figures = {"clips": len(clouds.rows), "frames": frames, "method": method, "seconds": seconds}
    return StageReport(output=config.output, lines=[line], figures=figures)


@contextmanager
def _opened(config: Config) -> Iterator[_Clouds]:
    if config.tpc is not None:
        with TpcReader(config.tpc) as reader:
            yield _Stored(reader, config)
        return
    with LatentReader(str(config.latent)) as latents:
        yield _Decoded(latents, config)


class _Stored:
    """Clouds of a tpc artefact: positions and groups alone leave here, whatever its layout."""

    def __init__(self, reader: TpcReader, config: Config):
        self.artefacts = [reader.artefact]
        self.rows = chosen_rows(reader.clips, config.splits, config.tpc)
        self._reader, self._sigma_m = reader, config.sigma_m

    def of(self, row: ClipRow) -> tuple[np.ndarray, np.ndarray]:
        return self._reader.points(row.clip, sigma_m=self._sigma_m)


class _Decoded:
    """Clouds of latents."""

    def __init__(self, reader: LatentReader, config: Config):
        self._coder = load_autoencoder(str(config.ae), config.device)
        reader.check_encoder(self._coder.digest)
        self.artefacts = [reader.artefact, open_artefact(str(config.ae), "checkpoint")]
        self.rows = chosen_rows(reader.clips, config.splits, config.latent)
        self._reader, self._groups = reader, group_counts(config.points)
        self._noise = self._coder.draw_noise(config.points, config.seed)

    def of(self, row: ClipRow) -> tuple[np.ndarray, np.ndarray]:
        made = self._coder.decode(*latents_of(self._reader, row), torch.from_numpy(self._groups), self._noise)
        return made.cpu().numpy(), self._groups
