"""Windows that are slow to encode are used in several steps: which step uses which, and their files.

A window that comes back within a few hundred steps is memorised: consecutive passes over the same 512 windows had
0.83 of the base's error in the first and 0.43 in the sixth, and improved validation little. So draws are kept on the
disk for thousands of steps, and a step that draws nothing takes each row from another kept draw. (Data echoing with a
large buffer, Choi et al. 2019.)
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from data_schemas.errors import PumpsError

_ORDER = 3  # the purpose of the generators
_FIRST = 8  # this share of the kept draws (one in so many) is drawn before any is used again


@dataclass(frozen=True)
class Schedule:
    """The steps that draw windows, and the draws that the other steps use.

    reuse: steps for each draw; 1 draws at every step. kept: draws kept. seed: of the training.
    """

    reuse: int
    kept: int
    seed: int

    @property
    def _first(self) -> int:
        return max(1, self.kept // _FIRST)

    def draws_afresh(self, step: int) -> bool:
        """Whether a step draws its own windows."""
        return step < self._first or step % self.reuse == 0

    def source(self, step: int, row: int) -> int:
        """The step that drew the window of `row` of the batch at `step`. Its row has the same number, so that a
        process with some rows needs no others."""
        if self.draws_afresh(step):
            return step
        count = self._count(step)
        random = np.random.default_rng((self.seed, _ORDER, step, row))
        return self._step_of(int(random.integers(max(0, count - self.kept), count)))

    def oldest(self, step: int) -> int:
        """The step of the oldest draw that `step` or a later one may use."""
        return self._step_of(max(0, self._count(step) - self.kept))

    def _count(self, step: int) -> int:
        """Number of draws up to and including a step."""
        first = self._first
        return min(step + 1, first) + max(0, step // self.reuse - (first - 1) // self.reuse)

    def _step_of(self, draw: int) -> int:
        first = self._first
        return draw if draw < first else ((first - 1) // self.reuse + 1 + draw - first) * self.reuse


@dataclass
class LatentBatch:
    """Encoded windows: latents (B, T, D) and centroids (B, T, 3) metres of the true clouds and of the base, groups
    (B, P), known and valid (B, T). Then the frozen decoder's results: the decoded points' identities (B, P, Z), the
    true latents' clouds (B, T, P, 3) and the base's mean square distance to them (B, T)."""

    latents: Tensor
    centroids: Tensor
    base_latents: Tensor
    base_centroids: Tensor
    groups: Tensor
    known: Tensor
    valid: Tensor
    identities: Tensor
    true_clouds: Tensor
    base_squares: Tensor

    def to(self, device: torch.device) -> LatentBatch:
        """The same on a device."""
        return LatentBatch(*(getattr(self, each.name).to(device) for each in fields(self)))


class KeptWindows:
    """Encoded windows on the disk, a file for each draw; a file is written completely or not at all.

    Latents and clouds (about their centroids) are kept in half precision: 0.1 MB for 96 frames of 64 points.
    """

    def __init__(self, folder: Path):
        self.folder = folder

    def put(self, step: int, rows: Sequence[int], batch: LatentBatch) -> None:
        """Keep the windows that some rows drew at a step.

        Raises: PumpsError if they cannot be written; nothing of them is left.
        """
        path = self._path(step, rows)
        unfinished = path.with_suffix(f".{os.getpid()}")
        held = {each.name: getattr(batch, each.name).detach().cpu().contiguous() for each in fields(batch)}
        held["true_clouds"] = (batch.true_clouds - batch.centroids.unsqueeze(2)).half().cpu().contiguous()
        held |= {name: held[name].half() for name in ("latents", "base_latents")}
        held["groups"] = held["groups"].to(torch.uint8)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            save_file(held, unfinished)
            os.replace(unfinished, path)
        except (OSError, SafetensorError) as error:
            with suppress(OSError):
                unfinished.unlink()
            raise PumpsError(
                f"Encoded windows cannot be kept in {self.folder}: {error}.",
                "Free space on that disk, or lower --kept-windows; the same command then goes on.",
            ) from None

    def holds(self, step: int, rows: Sequence[int]) -> bool:
        """Whether these rows' draw of a step is kept."""
        return self._path(step, rows).is_file()

    def take(self, steps: Sequence[int], rows: Sequence[int]) -> LatentBatch:
        """For each row, its draw at its step in `steps`. All must be kept."""
        parts: list[dict[str, Tensor]] = []
        names = [each.name for each in fields(LatentBatch)]
        for place, step in enumerate(steps):
            with safe_open(self._path(step, rows), framework="pt") as file:
                parts.append({name: file.get_slice(name)[place] for name in names})
        found = {name: torch.stack([part[name] for part in parts]) for name in names}
        found |= {name: found[name].float() for name in ("latents", "base_latents", "true_clouds")}
        found["true_clouds"] += found["centroids"].unsqueeze(2)
        found["groups"] = found["groups"].long()
        return LatentBatch(**found)

    def forget_before(self, step: int) -> None:
        """Remove the draws of older steps."""
        for path in self.folder.glob("*.safetensors"):
            if int(path.stem.split("_")[0]) < step:
                path.unlink(missing_ok=True)

    def _path(self, step: int, rows: Sequence[int]) -> Path:
        return self.folder / f"{step:09d}_{rows[0]}_{len(rows)}.safetensors"
