"""`pumps doctor` names CUDA libraries that are of no use."""

from __future__ import annotations

from importlib.metadata import distributions
from pathlib import Path

import pytest
import torch

from stages.doctor import run as doctor
from stages.doctor.config import Config
from stages.doctor.cuda_libraries import CPU_BUILD

SIZES = {
    "torch": {"torch/lib/libtorch_cuda.so": 900_000_000, "torch/lib/libtorch_cpu.so": 400_000_000},
    "nvidia-cublas-cu12": {"nvidia/cublas/lib/libcublas.so.12": 600_000_000},
    "cuda-toolkit": {},
    "cuda_bindings": {"cuda/bindings/driver.so": 100_000_000},
    "triton": {"triton/_C/libtriton.so": 500_000_000},
    "numpy": {"numpy/core.so": 50_000_000},
    "nvidia-ml-py": {"pynvml.py": 1_000_000_000},
    "nvidia-nvtx": {"nvidia/nvtx.so": 1_000_000_000},
}
REQUIRED = {
    "torch": [
        "numpy", 'triton==3.4; platform_system == "Linux"', 'nvidia-ml-py; extra == "monitoring"',
        'cuda_toolkit[cublas]==13.0; platform_system == "Linux"',
    ],
    "cuda-toolkit": [
        'nvidia-cublas-cu12==13.0.*; sys_platform == "linux" and extra == "cublas"', 'nvidia-nvtx; extra == "nvtx"',
        "cuda-bindings>=13",
    ],
}  # fmt: skip


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Packages whose files are empty; their records state the sizes. torch requires all but the last two."""
    for name, files in SIZES.items():
        folder = tmp_path / f"{name.replace('-', '_')}-1.0.dist-info"
        folder.mkdir()
        requires = "".join(f"Requires-Dist: {each}\n" for each in REQUIRED.get(name, ()))
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n{requires}")
        for file in files:
            (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / file).touch()
        (folder / "RECORD").write_text("".join(f"{file},,{size}\n" for file, size in files.items()))
    monkeypatch.setattr(doctor, "distributions", lambda: distributions(path=[str(tmp_path)]))


@pytest.mark.parametrize(
    ("built_with", "gpu", "told"), [("12.8", False, True), ("12.8", True, False), (None, False, False)]
)
def test_cuda_without_a_gpu_is_told(installed, monkeypatch, built_with: str | None, gpu: bool, told: bool):
    monkeypatch.setattr(torch.version, "cuda", built_with)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: gpu)
    report = doctor.run(Config(device="cpu"))
    lines = [line for line in report.lines if line.startswith("cuda")]
    assert bool(lines) == told
    assert report.figures["unused_cuda_bytes"] == (2_100_000_000 if told else 0)
    if told:
        assert "2.1 GB" in lines[0] and CPU_BUILD in lines[0]
        assert "`pip uninstall torch cuda-bindings cuda-toolkit nvidia-cublas-cu12 triton`" in lines[0]


def test_where_no_library_is_installed_nothing_is_told(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(torch.version, "cuda", "12.8")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(doctor, "distributions", lambda: distributions(path=[str(tmp_path)]))
    assert not [line for line in doctor.run(Config(device="cpu")).lines if line.startswith("cuda")]
