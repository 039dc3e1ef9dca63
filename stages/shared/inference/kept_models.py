"""Loaded models that stay in memory, for processes that fill more than one file."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from data_schemas.artefact import open_artefact
from stages.shared.inference.latent_denoiser import LatentDenoiser, load_denoiser
from stages.shared.inference.models import Autoencoder, Models, load_weights
from stages.shared.weights.shipped import parts_of, weights_folder


def kept_models(weights: str, device: str) -> Models:
    """The models of weights of that name, as `load_weights`; loaded again where their files have changed.

    Raises: InputError for weights that are not there.
    """
    parts = parts_of(weights_folder(weights))
    digests = tuple(open_artefact(part, "checkpoint").manifest.digest for part in parts)
    return _loaded(weights, device, digests)


def kept_denoiser(path: Path, weights: str, device: str) -> LatentDenoiser:
    """A denoiser beside the autoencoder of these weights, as `load_denoiser`; loaded again where files have changed.

    Raises: InputError as `kept_models` and `load_denoiser`.
    """
    digest = open_artefact(path, "checkpoint").manifest.digest
    return _denoiser(path, digest, kept_models(weights, device).autoencoder)


@lru_cache(maxsize=2)
def _denoiser(path: Path, digest: str, autoencoder: Autoencoder) -> LatentDenoiser:
    """`digest` is that of the checkpoint's files."""
    return load_denoiser(path, autoencoder)


@lru_cache(maxsize=2)
def _loaded(weights: str, device: str, digests: tuple[str, ...]) -> Models:
    """`digests` are those of the weights' files."""
    return load_weights(weights, device)
