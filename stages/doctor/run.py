"""`pumps doctor`: versions, the device that would compute, the weights that are found."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, distributions, requires, version
from typing import Any

from data_schemas.manifest import open_artefact
from data_schemas.version import PUMPS_VERSION
from stages.doctor.config import Config
from stages.doctor.cuda_libraries import CudaLibraries, advice, cuda_libraries
from stages.shared.contract import StageReport
from stages.shared.progress import SILENT, Progress
from stages.shared.weights.licence_names import licence_names


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Look around and tell.

    Raises:
        UsageError: the device that the config names is not there.
    """
    progress.start("Looking at the device")
    packages, device, weights = _packages(), _device(config.device), _weights()
    python = f"{platform.python_version()} on {platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    lines = [f"pumps    {PUMPS_VERSION}", f"python   {python}"]
    lines += [f"{name:8} {found or 'MISSING: install pumps again'}" for name, found in packages.items()]
    lines.append(f"device   {device['name']}, {device['precision']}")
    unused = _unused_cuda()
    lines += [f"cuda     {advice(unused)}"] if unused and unused.bytes else []
    lines += [f"weights  {each['name']}: {each['says']}" for each in weights] or ["weights  none are shipped"]
    figures = {"pumps": PUMPS_VERSION, "python": python, "packages": packages, "device": device, "weights": weights,
               "unused_cuda_bytes": unused.bytes if unused else 0}  # fmt: skip
    return StageReport(lines=lines, figures=figures)


def _packages() -> dict[str, str | None]:
    """Every package that pumps needs, with the version found, or None."""
    try:
        needed = [line for line in requires("pumps") or [] if "extra ==" not in line and "python_version" not in line]
    except PackageNotFoundError:  # run from a source tree that is not installed
        needed = ["torch", "numpy", "scipy", "h5py", "pyarrow", "pydantic", "typer"]
    names = sorted({_name_of(line) for line in needed})
    return {name: _version_of(name) for name in names}


def _version_of(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _name_of(requirement: str) -> str:
    """The bare name in front of a requirement's version range."""
    end = next((at for at, letter in enumerate(requirement) if not (letter.isalnum() or letter in "-_.")), None)
    return requirement[:end]


def _device(asked: str) -> dict[str, str]:
    import torch

    from stages.shared.networks.layers.device import choose_device, computes_bfloat16

    device = choose_device(asked)
    name = torch.cuda.get_device_name(device) if device.type == "cuda" else f"{torch.get_num_threads()} threads"
    precision = "bfloat16 in the networks" if computes_bfloat16(device) else "float32"
    return {"type": device.type, "name": f"{device.type} ({name})", "precision": precision}


def _unused_cuda() -> CudaLibraries | None:
    """The CUDA libraries, where PyTorch was built with CUDA and finds no GPU."""
    import torch

    if torch.version.cuda is None or torch.cuda.is_available():
        return None
    return cuda_libraries(distributions())


def _weights() -> list[dict[str, Any]]:
    """The shipped weights, with the licences of what they were trained on."""
    from stages.shared.weights.shipped import shipped_weights, weights_folder

    found = []
    for name in shipped_weights():
        manifest = open_artefact(weights_folder(name) / "lms", "checkpoint").manifest
        says = f"licences: {licence_names(manifest.licences)} (pumps weights show {name})"
        found.append({"name": name, "digest": manifest.digest, "licences": manifest.licences, "says": says})
    return found
