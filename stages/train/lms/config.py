"""Settings of `pumps train lms`."""

from __future__ import annotations

from stages.shared.synthesiser_training.config import SynthesiserTrainingConfig


class Config(SynthesiserTrainingConfig):
    """Train the latent motion synthesiser with the frozen encoder (PUMPS 3.3)."""
