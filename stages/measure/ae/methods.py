"""The measured autoencoders, and the row of PUMPS Table 2 of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import UsageError
from data_schemas.manifest import open_artefact
from stages.measure.ae.config import Config
from stages.shared.inference.models import Autoencoder, load_autoencoder
from stages.shared.weights.shipped import named_source

FULL = "the full method"
# The change -> L_rec of PUMPS Table 2.
PAPER = {
    FULL: 0.0029,
    "2D grid for identities (FoldingNet)": 0.0040,
    "sinusoidal positions": 0.0052,
    "Chamfer objective": 0.0085,
    "element-wise dropout": 0.0204,
    "VAE codes (PointIVAE)": 0.0260,
}
SKINNING = "skinning head (ours)"
_CHANGES = (
    (("decoder", "identities"), "grid", "2D grid for identities (FoldingNet)"),
    (("decoder", "positions"), "sinusoidal", "sinusoidal positions"),
    (("loss",), "chamfer", "Chamfer objective"),
    (("decoder", "dropout_kind"), "element", "element-wise dropout"),
    (("decoder", "identities"), "vae", "VAE codes (PointIVAE)"),
    (("decoder", "head"), "skinning", SKINNING),
)


@dataclass(frozen=True)
class Method:
    """An autoencoder in use.

    change:     changes to the full method in its training's settings, joined by commas.
    training:   the settings that it was trained with. parameters: their number. minutes: of its training.
    """

    name: str
    source: Path
    autoencoder: Autoencoder
    change: str
    training: dict[str, Any]
    parameters: int
    minutes: float


def load_methods(config: Config) -> list[Method]:
    """Every autoencoder that `config.weights` names.

    Raises: InputError if one cannot be loaded, UsageError if two have the same name.
    """
    methods: dict[str, Method] = {}
    for text in config.weights:
        name, source = named_source(text)
        if name in methods:
            raise UsageError(f"Two autoencoders are called {name!r}.", f"Give another name: --weights NAME={source}.")
        artefact = open_artefact(source, "checkpoint")
        training, kept = artefact.manifest.config, read_checkpoint(artefact, optimiser=False)
        methods[name] = Method(
            name,
            Path(source),
            load_autoencoder(source, config.device),
            change_of({**training, "decoder": kept.config.get("decoder", {})}),
            training,
            sum(values.size for values in kept.weights.values()),
            max((float(row.get("seconds", 0)) for row in kept.log), default=0.0) / 60,
        )
    return list(methods.values())


def change_of(training: Mapping[str, Any]) -> str:
    """The changes of a training's settings to PUMPS' full method, in the words of `PAPER` if it has them."""
    changes = []
    for path, value, words in _CHANGES:
        found: Any = training
        for key in path:
            found = found.get(key) if isinstance(found, Mapping) else None
        if found == value:
            changes.append(words)
    return ", ".join(changes) or FULL
