"""The log of a training: rows for the checkpoint, written in parts between checkpoints, and for TensorBoard."""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from data_schemas.checkpoint import log_bytes
from data_schemas.errors import PumpsError
from data_schemas.whole_file import write_whole
from stages.shared.training.config import TrainingConfig

_EVERY_S = 30.0  # most of the log that is lost when the process is killed


class TrainingLog:
    """Rows of numbers, `split` "train" or "val", each with its step and the seconds of training so far.

    Args:
        folder: where parts are written until a checkpoint holds their rows.
        rows: earlier rows of a run that is resumed.
    """

    def __init__(self, config: TrainingConfig, folder: Path, rows: list[dict[str, Any]]):
        self.rows, self.folder = rows, folder
        self._saved = len(rows)
        self._when = time.monotonic()
        self._board = _tensorboard(config, rows[-1]["step"] + 1 if rows else 0)

    def add(self, split: str, step: int, seconds: float, figures: Mapping[str, float]) -> None:
        """Add one row."""
        self.rows.append({"step": step, "seconds": seconds, "split": split, **figures})
        if self._board is not None:
            for name, value in figures.items():
                self._board.add_scalar(f"{split}/{name}", value, step)
        if time.monotonic() - self._when > _EVERY_S:
            self.save_part()

    def save_part(self) -> None:
        """Write the rows since the last part or checkpoint to a new part."""
        rows = self.rows[self._saved :]
        if rows:
            write_whole(self.folder / f"step_{rows[-1]['step']:09d}.parquet", log_bytes(rows))
        self.forget_parts(keep=True)

    def forget_parts(self, *, keep: bool = False) -> None:
        """Remove the parts: a checkpoint holds all rows so far."""
        self._saved, self._when = len(self.rows), time.monotonic()
        if not keep:
            shutil.rmtree(self.folder, ignore_errors=True)

    def close(self) -> None:
        """Write all remaining rows and close the log."""
        if self._board is not None:
            self._board.close()


def _tensorboard(config: TrainingConfig, first_step: int) -> Any:
    if not config.tensorboard:
        return None
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise PumpsError(
            "TensorBoard is not installed.", "Install it with: pip install 'pumps[tensorboard]'."
        ) from error
    folder = Path(config.output).with_name(config.output.name + ".tensorboard")
    return SummaryWriter(folder, purge_step=first_step)
