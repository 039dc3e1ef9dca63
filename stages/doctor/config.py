"""Settings of `pumps doctor`."""

from __future__ import annotations

from stages.config import DeviceConfig


class Config(DeviceConfig):
    """Tell versions, devices and weights."""
