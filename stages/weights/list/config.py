"""Settings of `pumps weights list`."""

from __future__ import annotations

from stages.shared.contract import StageConfig


class Config(StageConfig):
    """List the weights that come with pumps or were fetched: size, licences, what they were trained on."""
