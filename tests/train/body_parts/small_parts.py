"""Motions of the clips that come with pumps, and body parts trained on them for a few steps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest
from stages.train.body_parts.config import Config
from tests.docs.pages import ROOT

CLIPS = ROOT / "stages" / "shared" / "clips"
SMALL: dict[str, Any] = {
    "steps": 3, "batch": 4, "window": 16, "rate_hz": 30.0, "latent": 30, "blocks": 1, "cycle": 4,
    "validate_every": 3, "checkpoint_every": 3, "device": "cpu", "learning_rate": 1e-3,
}  # fmt: skip


def ingested(folder: Path, names: tuple[str, ...] = ("walk", "run", "kick")) -> Path:
    """A motion artefact of clips; walk is the test clip and kick that for validation."""
    splits = folder / "splits.json"
    splits.write_text('{"clips": {"test": ["walk.bvh"], "val": ["kick.bvh"], "train": "the rest"}}')
    sources = tuple(str(CLIPS / f"{name}.bvh") for name in names)
    ingest(IngestConfig(sources=sources, output=folder / "ingest", licence="CC0", workers=1, splits=splits))
    return folder / "ingest"


def settings(motion: Path, output: Path, **changed: Any) -> Config:
    """Settings of a small training."""
    return Config.model_validate({**SMALL, "motion": motion, "output": output, **changed})
