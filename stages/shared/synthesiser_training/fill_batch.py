"""The batches of the synthesiser's training, before encoding."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor


@dataclass
class FillBatch:
    """points and base (B, T, P, 3) metres, groups (B, P), known and valid (B, T); `step` and `rows` name the draw."""

    points: Tensor
    base: Tensor | None
    groups: Tensor
    known: Tensor
    valid: Tensor
    step: int = -1
    rows: tuple[int, ...] = ()


@dataclass
class KeptBatch:
    """Rows of a batch whose encoded windows are kept: drawn at earlier steps, or by the process that draws ahead."""

    step: int
    rows: tuple[int, ...]
