"""Settings of `pumps stream`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import DeviceConfig, SeededConfig, WritingConfig


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Measure motion that is streamed in packets, some of them lost."""

    motion: Path = Field(description="The motion artefact whose clips are streamed.")
    weights: tuple[str, ...] = Field(
        description="NAME=FOLDER of `pumps train body-parts`, each a way of streaming.", min_length=1
    )
    output: Path = Field(description="Folder of the metrics artefact.")
    splits: tuple[str, ...] = Field(("test",), description="Splits to stream.")
    max_clips: int = Field(20, description="Clips to stream, spread evenly; 0 for all.", ge=0)
    clip_seconds: float = Field(20.0, description="Seconds of each clip, from its start; 0 for all.", ge=0)
    loss: tuple[float, ...] = Field(
        (0.0, 0.05, 0.1, 0.2, 0.3), description="Shares of packets that are lost.", min_length=1
    )
    burst: float = Field(3.0, description="Mean number of packets that are lost one after another.", ge=1)
    seeds: int = Field(5, description="Seeds of the losses.", ge=1)
    bits: int = Field(8, description="Bits of one number of a latent.", ge=1, le=16)
    header_bytes: int = Field(
        32, description="Bytes of a packet besides its numbers: IP, UDP, place in the stream.", ge=0
    )
    every: tuple[int, ...] = Field(
        (1, 8), description="Quantised rotations are sent every so many frames; several for several rows."
    )
    absent: tuple[str, ...] = Field(
        ("left_leg", "right_leg"), description="Body groups that are hidden from the networks in one experiment."
    )
