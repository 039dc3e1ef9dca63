"""Settings of `pumps weights adapt`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import NAMES_OF, DeviceConfig, SeededConfig, WritingConfig
from stages.shared.weights.shipped import default_weights

OWN_LICENCE = "the recordings' own"


class Config(WritingConfig, DeviceConfig, SeededConfig):
    """Continue the training of weights on your own recordings; keep the result only if it is better on
    recordings that are held out."""

    clips: tuple[str, ...] = Field(
        description="Recordings of any rigs and formats: files, folders, globs, archives, FILE.zip!MEMBER; or motion "
        "artefacts of `pumps ingest`.",
        min_length=1,
    )
    output: Path = Field(description="Folder for the adapted weights, for --weights of other commands.")
    weights: str = Field(
        default_factory=default_weights,
        json_schema_extra={NAMES_OF: "weights"},
        description="Weights to start from: a shipped name or a folder.",
    )
    minutes: float = Field(10, gt=0, description="Minutes of training, over all calls if it was interrupted.")
    steps: int = Field(0, ge=0, description="Finish after this many optimiser steps instead of after --minutes.")
    skeleton: str | None = Field(
        None,
        description="Skeleton for files that have none: an ASF for AMC, a URDF for a robot's joint angles, a BVH or "
        "the name of a joint list for positions.",
    )
    licence: str = Field(OWN_LICENCE, description="Licence of the recordings, which the adapted weights carry too.")
    # At 1e-3 the held-out error rose from the first validation on (docs/log.md, 2026-11-29).
    learning_rate: float = Field(3e-4, gt=0, description="Highest learning rate.")
    batch: int = Field(8, ge=1, description="Windows per step.")
    validate_every: int = Field(50, ge=1, description="Steps between validations on the clips that are held out.")
    max_windows: int = Field(
        12,
        ge=2,
        description="Most stretches of the held-out clips that are measured; each is filled once for every task.",
    )
