"""The methods by name. Imports no torch, so that settings can be checked without it.

An installed package adds methods by entry points of the group `pumps.methods`, such as
`mine = "my_package.my_module:MyMethod"`.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import entry_points
from typing import TYPE_CHECKING

from data_schemas.errors import UsageError

if TYPE_CHECKING:
    from stages.shared.networks.inbetween.method import Method

ENTRY_POINTS = "pumps.methods"
_HERE = "stages.shared.networks.inbetween"
METHODS: dict[str, str] = {
    "delta": f"{_HERE}.delta_interpolator:DeltaInterpolator",
    "bert": f"{_HERE}.bert_completion:BertCompletion",
    "tg-complete": f"{_HERE}.tg_complete:TgComplete",
    "mae": f"{_HERE}.masked_autoencoder:MaskedAutoencoder",
    "two-stage": f"{_HERE}.two_stage:TwoStage",
    "pose-ndf": f"{_HERE}.pose_ndf:PoseNdf",
    "motion-vae": f"{_HERE}.motion_vae:MotionVae",
}


def method_names() -> list[str]:
    """The names that `method_class` knows."""
    return [*METHODS, *(each.name for each in entry_points(group=ENTRY_POINTS) if each.name not in METHODS)]


def method_class(name: str) -> type[Method]:
    """The class of a method. Raises UsageError for an unknown name."""
    place = METHODS.get(name)
    for entry in entry_points(group=ENTRY_POINTS):
        place = place or (entry.value if entry.name == name else None)
    if place is None:
        raise UsageError(f"There is no method {name!r}.", f"Take one of {', '.join(method_names())}.")
    module, _, attribute = place.partition(":")
    return getattr(import_module(module), attribute)
