"""Settings of `pumps decode`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Decode latents or clouds: into clouds, onto skeletons whose keyframes are known, or onto a network's rig.

    Latents (`latent` with `ae`) become clouds; clouds come as they are (`tpc`). `motion`: its keyframes anchor each
    clip's own skeleton, which follows the cloud (method solve). `network`: every clip goes to the rig that the
    network was trained for (methods network and both). Neither: the clouds of latents are written.
    """

    latent: Path | None = Field(None, description="The latent artefact to decode.")
    ae: Path | None = Field(None, description="Checkpoint artefact of the autoencoder, for --latent.")
    tpc: Path | None = Field(None, description="The tpc artefact to decode instead of latents.")
    network: Path | None = Field(
        None,
        description="Checkpoint of `pumps train skeleton`: all clips are put on the rig that it was trained for.",
    )
    method: Literal["solve", "network", "both"] | None = Field(
        None,
        description="How to compute poses. solve: from keyframes. network: by the network. both: solve, starting "
        "from the network's pose. Default: network if --network is given, else solve.",
    )
    motion: Path | None = Field(
        None,
        description="The motion artefact with the skeletons and keyframes of the clips; without it and without "
        "--network, clouds are written.",
    )
    keyframes: str = Field("every:15", description="Frames of --motion, at 30 per second, that are known.")
    splits: tuple[str, ...] = Field(("test",), description="Splits to decode.")
    points: int = Field(256, description="Points per cloud.")
    sigma_m: float = Field(
        0.05,
        description="Standard deviation of the points' offsets from the bones, in metres, for a rigid tpc artefact.",
        ge=0,
    )
    output: Path = Field(description="Folder of the artefact: motion with --motion or --network, else tpc.")
