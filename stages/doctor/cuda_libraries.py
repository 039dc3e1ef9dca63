"""The CUDA libraries that come with PyTorch: gigabytes that are of no use without a GPU."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from importlib.metadata import Distribution
from typing import NamedTuple

_BEGINNINGS = ("nvidia-", "cuda-")
_NAMES = ("triton", "pytorch-triton")
_REQUIREMENT = re.compile(r"([A-Za-z0-9._-]+)\s*(?:\[([^]]*)\])?")
_EXTRA = re.compile(r"""extra\s*==\s*["']([^"']+)["']""")
CPU_BUILD = "pip install torch --index-url https://download.pytorch.org/whl/cpu"


class CudaLibraries(NamedTuple):
    """bytes: on the disk, those in torch itself included. packages: names of the other packages that hold them."""

    bytes: int
    packages: tuple[str, ...]


def cuda_libraries(installed: Iterable[Distribution]) -> CudaLibraries:
    """The CUDA libraries that torch requires, among installed packages, by the sizes that their records state.

    Libraries that torch does not require, directly or through others, belong to other programs.
    """
    named = {_plain(each.metadata["Name"] or ""): each for each in installed}
    size, packages = 0, []
    for name in sorted(_required("torch", named)):
        if name.startswith(_BEGINNINGS) or name in _NAMES:
            packages.append(name)
            size += sum(file.size or 0 for file in named[name].files or ())
        elif name == "torch":
            size += sum(file.size or 0 for file in named[name].files or () if _is_of_cuda(file.name))
    return CudaLibraries(size, tuple(packages))


def advice(found: CudaLibraries) -> str:
    """What a user without a GPU reads: how much disk they take, and the commands that leave PyTorch's CPU build."""
    remove = " ".join(("pip uninstall torch", *found.packages))
    return (
        f"{found.bytes / 1e9:.1f} GB of CUDA libraries are installed, and PyTorch finds no GPU. "
        f"The CPU build does without them: `{remove}`, then `{CPU_BUILD}`."
    )


def _required(package: str, named: Mapping[str, Distribution]) -> set[str]:
    """An installed package, and the installed ones that it requires, directly or through others."""
    seen: set[tuple[str, frozenset[str]]] = set()
    to_do = [(package, frozenset[str]())]
    while to_do:
        name, extras = to_do.pop()
        if name not in named or (name, extras) in seen:
            continue
        seen.add((name, extras))
        for line in named[name].requires or ():
            requirement, _, condition = line.partition(";")
            found, of_extras = _REQUIREMENT.match(requirement.strip()), set(map(_plain, _EXTRA.findall(condition)))
            if found and (not of_extras or of_extras & extras):
                asked = (_plain(each) for each in (found[2] or "").split(",") if each.strip())
                to_do.append((_plain(found[1]), frozenset(asked)))
    return {name for name, _ in seen}


def _plain(name: str) -> str:
    """The form in which names of packages, and of their extras, are compared."""
    return re.sub(r"[-_.]+", "-", name.strip()).lower()


def _is_of_cuda(file: str) -> bool:
    return ".so" in file and any(word in file for word in ("cuda", "cudnn", "cublas", "nccl"))
