"""Trainings of a few steps as commands of their own, for tests that start, spread and kill them."""

from __future__ import annotations

import os
import subprocess
import sysconfig
from pathlib import Path
from typing import Any

import numpy as np

from data_schemas.checkpoint import read_checkpoint

ROOT = Path(__file__).resolve().parents[3]

TINY: dict[str, Any] = {
    "steps": 6,
    "batch": 2,
    "window": 8,
    "points": 24,
    "warmup": 2,
    "validate_every": 3,
    "checkpoint_every": 2,
    "device": "cpu",
    "encoder": {"width": 8, "blocks": 2, "neighbours": 4, "heads": 2},
    "decoder": {"width": 16, "layers": 1, "heads": 2, "noise": 4, "point_width": 8, "point_hidden": 8},
}


def flags_of(settings: dict[str, Any], table: str = "") -> list[str]:
    """Settings as flags of `pumps train ae`."""
    flags: list[str] = []
    for name, value in settings.items():
        if isinstance(value, dict):
            flags += flags_of(value, f"{name}.")
        elif isinstance(value, bool):
            flags += ["--" + (table + ("" if value else "no-") + name).replace("_", "-")]
        else:
            flags += ["--" + (table + name).replace("_", "-"), str(value)]
    return flags


def start_training(
    clouds: Path, output: Path, processes: int = 1, *, folder: Path = ROOT, **changes: Any
) -> subprocess.Popen[str]:
    """`pumps train ae` on the tiny sizes from a folder, by itself or under torchrun, as docs/training.md has it."""
    scripts = Path(sysconfig.get_path("scripts"))
    launcher = [str(scripts / "torchrun"), "--standalone", "--nproc-per-node", str(processes), "--no-python"]
    command = [
        *(launcher if processes > 1 else []), str(scripts / "pumps"), "train", "ae",
        "--tpc", str(clouds), "-o", str(output), *flags_of({**TINY, **changes}),
    ]  # fmt: skip
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        command, cwd=folder, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )


def figures_of(path: Path) -> list[dict[str, Any]]:
    """The log of a finished run, without how long it took."""
    rows = read_checkpoint(path).log
    return [{name: value for name, value in row.items() if name != "seconds"} for row in rows]


def weights_of(path: Path) -> dict[str, np.ndarray]:
    return read_checkpoint(path).weights
