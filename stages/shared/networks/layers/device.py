"""The device for computing, and its precision."""

from __future__ import annotations

import os
from contextlib import AbstractContextManager, nullcontext

import torch

from data_schemas.errors import UsageError


def choose_device(name: str) -> torch.device:
    """`auto` takes CUDA, then Apple's MPS, then the CPU; each process of a launcher takes its own GPU.

    Raises: UsageError if the device does not exist; the message names those that do.
    """
    available = ["cpu"]
    if torch.cuda.is_available():
        available.insert(0, "cuda")
    elif torch.backends.mps.is_available():
        available.insert(0, "mps")
    if name == "auto":
        name = available[0]
    if name.split(":")[0] not in available:
        raise UsageError(f"The device {name} is not available here.", f"Use --device {' or '.join(available)}.")
    if name == "cuda" and "LOCAL_RANK" in os.environ:  # the number of the process on its host
        return torch.device(name, int(os.environ["LOCAL_RANK"]) % torch.cuda.device_count())
    return torch.device(name)


def computes_bfloat16(device: torch.device) -> bool:
    """Whether bfloat16 products are faster than float32 on a device.

    On GPUs since Ampere; on CPUs with AMX tiles or AVX-512's bfloat16 dot products (docs/performance.md has figures).
    """
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    if device.type == "cpu":
        asks = [getattr(torch.cpu, name, None) for name in ("_is_amx_tile_supported", "_is_avx512_bf16_supported")]
        return any(ask is not None and ask() for ask in asks)
    return False


def precision(device: torch.device, mixed: bool) -> AbstractContextManager:
    """Autocast to bfloat16 if `mixed` and the device is faster with it; otherwise no autocast."""
    if mixed and computes_bfloat16(device):
        return torch.autocast(device.type, torch.bfloat16)
    return nullcontext()
