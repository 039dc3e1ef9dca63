"""What a piece of work does, counted: floating-point operations, bytes, kernels, waits for the device."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils.flop_counter import flop_registry, sdpa_backward_flop_count, sdpa_flop_count

_PRODUCTS = ("mm", "linear", "attention", "convolution")
_PRODUCT_KERNELS = ("gemm", "gemv", "cutlass", "cublas", "flash", "fmha", "attention", "nvjet", "xmma", "cudnn")


class _Counter(TorchDispatchMode):
    """Floating-point operations of products and attention, and bytes that operations read and write (inputs and
    results, views left out). It sees operations alone, so also those of a backward pass within another."""

    flop = 0
    bytes = 0

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = kwargs or {}
        result = func(*args, **kwargs)
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


def work_of(run: Callable[[], object]) -> tuple[float, float]:
    """GFLOP of the matrix and attention operations, and GB that all operations read and write, recomputation and
    backward pass included."""
    with _Counter() as counter:
        run()
    return counter.flop / 1e9, counter.bytes / 1e9


def share_in_products(run: Callable[[], object], device: torch.device) -> tuple[float, list[tuple[str, float]]]:
    """Share of the time that goes to matrix and attention kernels, and the eight largest kernels with their shares;
    of the GPU's time on a GPU, of the processor's on a CPU."""
    on_gpu = device.type == "cuda"
    activities = [torch.profiler.ProfilerActivity.CUDA if on_gpu else torch.profiler.ProfilerActivity.CPU]
    with torch.profiler.profile(activities=activities) as profile:
        run()
        if on_gpu:
            torch.cuda.synchronize(device)
    times: dict[str, float] = {}
    for event in profile.key_averages():
        spent = event.self_device_time_total if on_gpu else event.self_cpu_time_total
        if on_gpu or event.key.startswith("aten::"):
            times[event.key] = times.get(event.key, 0.0) + spent
    total = sum(times.values()) or 1.0
    marks = _PRODUCT_KERNELS if on_gpu else _PRODUCTS
    in_products = sum(spent for name, spent in times.items() if any(mark in name.lower() for mark in marks))
    largest = sorted(times.items(), key=lambda item: -item[1])[:8]
    return in_products / total, [(name, spent / total) for name, spent in largest]


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
