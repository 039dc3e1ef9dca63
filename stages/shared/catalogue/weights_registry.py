"""A registry of weights that can be fetched: a TOML file with a table for each, on this machine or on a server."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import urlsplit

import requests
from pydantic import field_validator

from data_schemas.errors import InputError, PumpsError, UsageError
from stages.shared.catalogue.catalogue import SHA256, DataFile, Strict, entries_of

MOST_BYTES = 2 << 30  # of an archive of weights
_MOST_REGISTRY_BYTES = 1 << 20
_PATIENCE_S = 30
_ON_THIS_MACHINE = ("127.0.0.1", "::1", "localhost")


class RegisteredWeights(Strict):
    """Weights of a registry.

    url:      of an archive with `ae` and `lms`, or with the checkpoint of one task (`pumps weights pack`).
    bytes:    of the archive.
    checksum: of the archive, "sha256:...".
    licences: those of the data that the weights were trained on, as their manifests state them.
    terms:    what the licences ask, in words.
    """

    title: str
    home: str
    url: str
    bytes: int
    checksum: str
    licences: tuple[str, ...]
    licence_url: str = ""
    terms: str = ""

    @field_validator("licences")
    @classmethod
    def _stated(cls, licences: tuple[str, ...]) -> tuple[str, ...]:
        if not licences:
            raise ValueError("must name one licence at least")
        return licences

    @field_validator("bytes")
    @classmethod
    def _bounded(cls, size: int) -> int:
        if not 0 < size <= MOST_BYTES:
            raise ValueError(f"must be from 1 to {MOST_BYTES:,}")
        return size

    @field_validator("checksum")
    @classmethod
    def _sha256(cls, checksum: str) -> str:
        return checked_sha256(checksum)

    @property
    def licence(self) -> str:
        """All licences, as one text."""
        return "; ".join(self.licences)

    def file(self, name: str) -> DataFile:
        """The archive, to be stored under this name. Raises ValueError for an address that is not of the web."""
        return DataFile(
            name=name, url=self.url, bytes=self.bytes, checksum=self.checksum, checksum_from="the registry"
        )


def checked_sha256(checksum: str) -> str:
    """The checksum. Raises ValueError where it is not "sha256:" and 64 hexadecimal digits in lower case."""
    if not SHA256.fullmatch(checksum):
        raise ValueError("must be sha256:<64 hex digits>")
    return checksum


def read_registry(place: str) -> dict[str, RegisteredWeights]:
    """The weights of a registry by name, in its order.

    Args:
        place: a file, or an address. Only of this machine may it be http, since whoever changes a registry on its way
            changes the checksums too.

    Raises: InputError listing every fault of the registry; UsageError for an address that is not https, or that
        redirects to such a one; PumpsError if the server cannot be reached.
    """
    if is_address(place):
        return entries_of(place, _downloaded(place), RegisteredWeights, "registry of weights")
    try:
        data = Path(place).read_bytes()
    except OSError as error:
        raise InputError(f"{place} cannot be read: {error.strerror}.", "Check the path of the registry.") from error
    return entries_of(place, data, RegisteredWeights, "registry of weights")


def is_address(text: str) -> bool:
    """Whether a text is an address of the web."""
    return text.startswith(("http://", "https://"))


def _check_address(address: str) -> None:
    """Raise UsageError unless nobody can change what comes from there on its way."""
    parts = urlsplit(address)
    if parts.scheme != "https" and parts.hostname not in _ON_THIS_MACHINE:
        raise UsageError(f"{address} can be changed on its way, and its checksums with it.", "Give an https address.")


def _downloaded(address: str) -> bytes:
    _check_address(address)
    try:
        with requests.get(address, stream=True, timeout=_PATIENCE_S) as answer:
            for each in (*answer.history, answer):
                _check_address(each.url)
            if answer.status_code != 200:
                raise PumpsError(f"{address} answers {answer.status_code} {answer.reason}.", "Check the address.")
            data = b""
            for block in answer.iter_content(1 << 16):
                data += block
                if len(data) > _MOST_REGISTRY_BYTES:
                    raise InputError(f"{address} has more than {_MOST_REGISTRY_BYTES:,} bytes.", "Check the address.")
            return data
    except requests.RequestException as error:
        raise PumpsError(
            f"{address} cannot be reached.", "Try again later, or give a file with --registry."
        ) from error
