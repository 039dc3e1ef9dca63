"""Loaded models that stay in memory, for processes that fill more than one file."""

from __future__ import annotations

from functools import lru_cache

from data_schemas.artefact import open_artefact
from stages.shared.inference.models import Models, load_weights
from stages.shared.weights.shipped import parts_of, weights_folder


def kept_models(weights: str, device: str) -> Models:
    """The models of weights of that name, as `load_weights`; loaded again where their files have changed.

    Raises: InputError for weights that are not there.
    """
    parts = parts_of(weights_folder(weights))
    digests = tuple(open_artefact(part, "checkpoint").manifest.digest for part in parts)
    return _loaded(weights, device, digests)


@lru_cache(maxsize=2)
def _loaded(weights: str, device: str, digests: tuple[str, ...]) -> Models:
    """`digests` are those of the weights' files."""
    return load_weights(weights, device)
