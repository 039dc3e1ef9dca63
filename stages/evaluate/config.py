"""Settings of `pumps evaluate`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.config import DeviceConfig


class Config(DeviceConfig):
    """Measure filling on a `motion` artefact beside LERP and SLERP (task definitions in docs/evaluation.md)."""

    motion: Path = Field(description="The motion artefact whose test clips are filled.")
    output: Path = Field(description="Folder of the metrics artefact.")
    weights: tuple[str, ...] = Field((), description="NAME=FOLDER or NAME of shipped weights; each is a method of the table.")
    tasks: tuple[str, ...] = Field(("interpolation", "transition", "prediction"), description="Tasks to measure.")
    intervals: tuple[int, ...] = Field((5, 15, 30), description="Frames between keys in interpolation.")
    transitions: tuple[int, ...] = Field((15, 30, 60), description="Missing frames in transitions.")
    predictions: tuple[int, ...] = Field((15, 30), description="Last frames to predict.")
    window: int = Field(121, description="Frames in a window of interpolation.")
    splits: tuple[str, ...] = Field(("test",), description="Which splits are measured.")
    max_windows: int = Field(0, description="Windows for each skeleton and task, spread evenly over clips; 0 for all.")
    breakdown: bool = Field(False, description="Also the solve on true clouds, and on clouds reconstructed with nothing masked.")
    protocol: str = Field("pumps", description="pumps, or lafan1 (that benchmark's own definitions).")
    points: int = Field(256, description="Points of the cloud.")
