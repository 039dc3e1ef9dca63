"""The CUDA libraries that come with PyTorch: gigabytes that are of no use without a GPU."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import Distribution
from typing import NamedTuple

_BEGINNINGS = ("nvidia-", "cuda-")
_NAMES = ("triton", "pytorch-triton")
CPU_BUILD = "pip install torch --index-url https://download.pytorch.org/whl/cpu"


class CudaLibraries(NamedTuple):
    """bytes: on the disk, those in torch itself included. packages: names of the other packages that hold them."""

    bytes: int
    packages: tuple[str, ...]


def cuda_libraries(installed: Iterable[Distribution]) -> CudaLibraries:
    """The CUDA libraries among installed packages, by the sizes that their records state."""
    size, packages = 0, set()
    for each in installed:
        name = (each.metadata["Name"] or "").lower().replace("_", "-")
        if name.startswith(_BEGINNINGS) or name in _NAMES:
            packages.add(name)
            size += sum(file.size or 0 for file in each.files or ())
        elif name == "torch":
            size += sum(file.size or 0 for file in each.files or () if _is_of_cuda(file.name))
    return CudaLibraries(size, tuple(sorted(packages)))


def advice(found: CudaLibraries) -> str:
    """What a user without a GPU reads: how much disk they take, and the commands that leave PyTorch's CPU build."""
    remove = " ".join(("pip uninstall torch", *found.packages))
    return (
        f"{found.bytes / 1e9:.1f} GB of CUDA libraries are installed, and PyTorch finds no GPU. "
        f"The CPU build does without them: `{remove}`, then `{CPU_BUILD}`."
    )


def _is_of_cuda(file: str) -> bool:
    return ".so" in file and any(word in file for word in ("cuda", "cudnn", "cublas", "nccl"))
