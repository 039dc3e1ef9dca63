"""What a piece of work does, counted: floating-point operations, bytes, kernels, waits for the device."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils.flop_counter import flop_registry, sdpa_backward_flop_count, sdpa_flop_count

_PRODUCTS = ("mm", "linear", "attention", "convolution")
_PRODUCT_KERNELS = ("gemm", "gemv", "cutlass", "cublas", "flash", "fmha", "attention", "nvjet", "xmma", "cudnn")


@dataclass(frozen=True)
class Work:
    """What one call does.

    gflop: floating-point operations of products and attention, recomputation and backward pass included, 1e9.
    gb: what all operations read and write, views left out, 1e9 bytes.
    in_products: share of the operations' time that products and attention take.
    largest: the eight operations that take longest, with their shares of that time.
    """

    gflop: float
    gb: float
    in_products: float
    largest: list[tuple[str, float]]


class _Counter(TorchDispatchMode):
    """Counts operations as they are called, so also those of a backward pass within another; and on a CPU, where an
    operation is done when its call returns, their seconds by name."""

    def __init__(self) -> None:
        super().__init__()
        self.flop, self.bytes = 0, 0
        self.seconds: dict[str, float] = {}

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = kwargs or {}
        if torch.is_inference_mode_enabled() and func._overloadpacket not in flop_registry:
            with self:  # inference mode passes a composite operation as a whole, not as its parts
                parts = func.decompose(*args, **kwargs)
            if parts is not NotImplemented:
                return parts
        began = time.perf_counter()
        result = func(*args, **kwargs)
        name = str(func._overloadpacket)
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - began
        if not func.is_view:
            self.bytes += _bytes(args) + _bytes(result)
        if func._overloadpacket in flop_registry:
            self.flop += flop_registry[func._overloadpacket](*args, **kwargs, out_val=result)
        elif func._overloadpacket is torch.ops.aten._scaled_dot_product_flash_attention_for_cpu:
            self.flop += sdpa_flop_count(*(each.shape for each in args[:3]))
        elif func._overloadpacket is torch.ops.aten._scaled_dot_product_flash_attention_for_cpu_backward:
            self.flop += sdpa_backward_flop_count(*(each.shape for each in args[:4]))
        return result


def _bytes(value: Any) -> int:
    if isinstance(value, torch.Tensor):
        return value.numel() * value.element_size()
    return sum(_bytes(each) for each in value) if isinstance(value, (list, tuple)) else 0


def work_of(run: Callable[[], object], device: torch.device) -> Work:
    """Count one call of `run`; on a GPU another is profiled, since there only the device knows its seconds."""
    with _Counter() as counter:
        run()
    seconds = _kernel_seconds(run, device) if device.type == "cuda" else counter.seconds
    marks = _PRODUCT_KERNELS if device.type == "cuda" else _PRODUCTS
    total = sum(seconds.values()) or 1.0
    in_products = sum(spent for name, spent in seconds.items() if any(mark in name.lower() for mark in marks))
    largest = sorted(seconds.items(), key=lambda item: -item[1])[:8]
    shares = [(name, spent / total) for name, spent in largest]
    return Work(counter.flop / 1e9, counter.bytes / 1e9, in_products / total, shares)


def _kernel_seconds(run: Callable[[], object], device: torch.device) -> dict[str, float]:
    """Seconds of the GPU's kernels by name."""
    with torch.profiler.profile(activities=[torch.profiler.ProfilerActivity.CUDA]) as profile:
        run()
        torch.cuda.synchronize(device)
    return {event.key: event.self_device_time_total / 1e6 for event in profile.key_averages()}


def waits_in(run: Callable[[], object], device: torch.device) -> list[str] | None:
    """Where the work waits for the GPU, one line for each time; None on a CPU."""
    if device.type != "cuda":
        return None
    torch.cuda.synchronize(device)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        torch.cuda.set_sync_debug_mode("warn")
        try:
            run()
        finally:
            torch.cuda.set_sync_debug_mode("default")
    return [f"{each.filename}:{each.lineno}" for each in caught if "synchroniz" in str(each.message)]
