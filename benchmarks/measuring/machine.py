"""What this machine can do, measured: matrix products and memory. And how much memory this process took."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable
from pathlib import Path

import torch

from stages.shared.memory import keep_freed_memory
from stages.shared.networks.layers.device import computes_bfloat16

keep_freed_memory()  # as pumps does


def finish(device: torch.device) -> None:
    """Wait until the device has done what it was given."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)


def undisturbed_seconds_of(work: Callable[[], object], device: torch.device) -> float:
    """Seconds of one call: on a CPU with one thread those of the processor, which other work on the machine changes
    little; otherwise those of the clock."""
    spent, wall = cpu_and_wall_s(work, device)
    return spent if device.type == "cpu" and torch.get_num_threads() == 1 else wall


def seconds_of(work: Callable[[], object], device: torch.device) -> float:
    """Wall time of one call."""
    finish(device)
    began = time.perf_counter()
    work()
    finish(device)
    return time.perf_counter() - began


def name_of(device: torch.device) -> str:
    """The processor's or GPU's name."""
    if device.type == "cuda":
        return torch.cuda.get_device_name(device)
    about = Path("/proc/cpuinfo")
    lines = about.read_text().splitlines() if about.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def cpu_and_wall_s(work: Callable[[], object], device: torch.device) -> tuple[float, float]:
    """Seconds of one call on all processors together, and by the clock. The first changes little where other work
    shares the machine, but only with one thread: several wait for each other busily."""
    before = time.process_time()
    wall = seconds_of(work, device)
    return time.process_time() - before, wall


def limits(device: torch.device) -> dict[str, Callable[[], float]]:
    """Measurements by name, to be called in turn with what is compared to them: products in GFLOP/s, copies in GB/s
    (bytes read and written), from main memory and within the cores' caches."""
    side = 8192 if device.type == "cuda" else 2048
    large = torch.ones(2**28 if device.type == "cuda" else 2**25, device=device)
    small = torch.ones(2**18, device=device)

    def product(dtype: torch.dtype) -> Callable[[], float]:
        one = torch.randn(side, side, device=device).to(dtype)
        return lambda: 2e-9 * side**3 / undisturbed_seconds_of(lambda: one @ one, device)

    def copy(values: torch.Tensor, times: int) -> Callable[[], float]:
        target = torch.zeros_like(values)

        def repeat() -> None:
            for _ in range(times):
                target.copy_(values)

        return lambda: 2e-9 * times * values.numel() * values.element_size() / undisturbed_seconds_of(repeat, device)

    found = {
        "matrix_float32_gflop_per_s": product(torch.float32),
        "memory_gb_per_s": copy(large, 2),
    }
    if computes_bfloat16(device):  # emulated, one product would take longer than all steps
        found["matrix_bfloat16_gflop_per_s"] = product(torch.bfloat16)
    if device.type == "cpu":
        found["cache_gb_per_s"] = copy(small, 500)
    return found


def resident_mb() -> tuple[float, float]:
    """Memory of this process now and at its peak, MB; zeros where the system does not say."""
    about = Path("/proc/self/status")
    lines = about.read_text().splitlines() if about.is_file() else []
    kb = {line.partition(":")[0]: line.split()[1] for line in lines if line.startswith(("VmRSS", "VmHWM"))}
    return float(kb.get("VmRSS", 0)) / 1e3, float(kb.get("VmHWM", 0)) / 1e3
