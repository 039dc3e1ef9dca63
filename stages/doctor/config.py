"""Settings of `pumps doctor`."""

from __future__ import annotations

from stages.shared.contract import DeviceConfig


class Config(DeviceConfig):
    """Tell versions, devices and weights."""
