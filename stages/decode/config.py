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

    latent: Path | None = Field(None, description="A latent artefact to decode.")
    ae: Path | None = Field(None, description="The autoencoder's checkpoint artefact, for latents.")
    tpc: Path | None = Field(None, description="A tpc artefact to put onto skeletons, instead of latents.")
    network: Path | None = Field(None, description="The checkpoint of `pumps train skeleton`.")
    method: Literal["solve", "network", "both"] | None = Field(
        None,
        description="solve: from keyframes. network: as the network says. both: the solve from the network's pose. "
        "Default: network where there is one, else solve.",
    )
    motion: Path | None = Field(
        None, description="Motion artefact whose keyframes anchor skeletons; none: clouds only."
    )
    keyframes: str = Field("every:15", description="Which frames of the motion, at 30 fps, are known.")
    splits: tuple[str, ...] = Field(("test",), description="Which splits to decode.")
    points: int = Field(256, description="Points of the cloud.")
    sigma_m: float = Field(
        0.05, description="Spread of a rigid tpc artefact's points around its bones, metres.", ge=0
    )
    output: Path = Field(description="Folder of the artefact: motion with --motion or --network, else tpc.")
