"""The `latent` artefact: the frame encoder's output for every frame.

`latents.h5`:
    attribute encoder_digest
    /clips/<clip>  latents (T, D) float16 or float32; centroids (T, 3) float32 metres
`clips.parquet`: one ClipRow a clip.
"""

from __future__ import annotations

import os

import numpy as np

from data_schemas.clips import ClipReader, ClipRow, ClipWriter
from data_schemas.damaged_files import reading
from data_schemas.errors import InputError
from data_schemas.hdf5_arrays import read_frames, write_frames
from data_schemas.manifest import Artefact

__all__ = ["ClipRow", "LatentReader", "LatentWriter"]


class LatentWriter(ClipWriter):
    """Writes latents into a draft's folder. Use as a context manager, or call `close`.

    Args:
        folder: an existing folder, such as `Draft.folder`.
        encoder_digest: digest of the checkpoint artefact whose encoder made the latents.
    """

    FILE = "latents.h5"

    def __init__(self, folder: str | os.PathLike[str], encoder_digest: str):
        super().__init__(folder)
        self._file.attrs["encoder_digest"] = encoder_digest
        self._width: int | None = None

    def add(self, row: ClipRow, latents: np.ndarray, centroids: np.ndarray) -> None:
        """Store a clip: latents (T, D), float16 if given so, else float32; centroids (T, 3) metres.

        Raises:
            InputError: the shapes do not match, the width differs from earlier clips', or values are not finite.
        """
        width = latents.shape[-1] if self._width is None else self._width
        for name, values, shape in (
            ("latents", latents, (row.frames, width)),
            ("centroids", centroids, (row.frames, 3)),
        ):
            if values.shape != shape:
                raise InputError(f"The clip {row.clip!r} has {name} of the shape {values.shape}, expected {shape}.")
            if not np.isfinite(values).all():
                raise InputError(f"The clip {row.clip!r} has values in {name} that are not finite.")
        group = self._new_clip(row, latents.shape[0])
        self._width = width
        write_frames(group, "latents", np.asarray(latents, np.float16 if latents.dtype == np.float16 else np.float32))
        write_frames(group, "centroids", np.asarray(centroids, np.float32))


class LatentReader(ClipReader):
    """Reads a `latent` artefact. `clips` is its index, `encoder_digest` the digest of the checkpoint that made it."""

    KIND = "latent"
    FILE = "latents.h5"

    def __init__(self, artefact: Artefact | str | os.PathLike[str]):
        super().__init__(artefact)
        with reading(self._path):
            self.encoder_digest = str(self._file.attrs["encoder_digest"])

    def check_encoder(self, digest: str) -> None:
        """Raise InputError unless these latents were made by the checkpoint with this digest."""
        if digest != self.encoder_digest:
            raise InputError(
                f"{self.artefact.path} was made by another encoder ({self.encoder_digest[:12]}) than the one given "
                f"({digest[:12]}).",
                "Run `pumps encode` again with this checkpoint.",
            )

    def latents(self, clip: str, start: int = 0, stop: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Latents (T, D) and centroids (T, 3) metres, both float32, of frames `start` to `stop` of a clip.

        Raises:
            InputError: no such clip or frames, or the file is damaged.
        """
        row = self.row(clip)
        window = self._window(row, start, stop)
        with reading(self._path):
            group = self._group(row)
            latents = read_frames(group, "latents", window, (None,), row.frames)
            centroids = read_frames(group, "centroids", window, (3,), row.frames)
            return latents.astype(np.float32, copy=False), centroids.astype(np.float32, copy=False)
