"""The wheel holds all that pumps needs, and works in an environment that holds nothing else."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from packaging.specifiers import SpecifierSet

from stages.shared.toml import toml_values
from tests.clean_environment import installed_bytes, make_environment

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("data_schemas", "pumps", "pumps_cli", "stages")
TOP = ("pyproject.toml", "README.md", "LICENSE", "NOTICE")
MOST_MB = 45  # of the wheel, and of the weights in it
BUILD = "import sys; from setuptools import build_meta as b; print(getattr(b, 'build_' + sys.argv[1])(sys.argv[2]))"


def _built(kind: str, source: Path, folder: Path) -> Path:
    command = [sys.executable, "-c", BUILD, kind, str(folder)]
    made = subprocess.run(command, cwd=source, check=True, capture_output=True, text=True)
    return folder / made.stdout.splitlines()[-1]


@pytest.fixture(scope="module")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy, since a build leaves a folder from which the next build takes files that are gone since."""
    source = tmp_path_factory.mktemp("source")
    for name in PACKAGES:
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in TOP:
        shutil.copy(ROOT / name, source / name)
    return _built("sdist", source, tmp_path_factory.mktemp("sdist"))


@pytest.fixture(scope="module")
def wheel(sdist: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from the sdist, as pip builds it: what the sdist lacks, the wheel lacks too."""
    unpacked = tmp_path_factory.mktemp("unpacked")
    with tarfile.open(sdist) as archive:
        archive.extractall(unpacked, filter="data")
    return _built("wheel", next(unpacked.iterdir()), tmp_path_factory.mktemp("wheel"))


def test_every_file_of_the_packages_is_in_the_wheel(wheel: Path) -> None:
    held = set(zipfile.ZipFile(wheel).namelist())
    wanted = {
        path.relative_to(ROOT).as_posix()
        for name in PACKAGES
        for path in (ROOT / name).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert not wanted - held
    assert {"licenses/LICENSE", "licenses/NOTICE"} <= {each.partition(".dist-info/")[2] for each in held}


def test_the_wheel_and_its_weights_are_small(wheel: Path) -> None:
    entries = zipfile.ZipFile(wheel).infolist()
    weights = sum(each.file_size for each in entries if each.filename.startswith("stages/shared/weights/"))
    assert 1e6 < weights <= MOST_MB * 1e6
    assert wheel.stat().st_size <= MOST_MB * 1e6


def test_classifiers_name_the_pythons_that_the_requirement_allows() -> None:
    project = toml_values((ROOT / "pyproject.toml").read_text())["project"]
    named = re.findall(r"Python :: (3\.\d+)", "\n".join(project["classifiers"]))
    allowed = SpecifierSet(project["requires-python"])
    assert named == ["3.10", "3.11", "3.12", "3.13"]
    assert [each for each in map("3.{}".format, range(14)) if f"{each}.0" in allowed] == named


def test_it_fills_a_clip_in_a_clean_environment(
    sdist: Path, wheel: Path, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """`.ci/run` prints what is recorded here."""
    python = make_environment(tmp_path / "env", wheel)
    site = next((tmp_path / "env").glob("lib/python*/site-packages"))
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    environment["OMP_NUM_THREADS"] = "1"
    own, others = installed_bytes(site)
    record_property("sdist", f"{sdist.stat().st_size / 1e6:.1f} MB")
    record_property("wheel", f"{wheel.stat().st_size / 1e6:.1f} MB, {own / 1e6:.1f} MB installed")
    record_property("what it requires", f"{others / 1e6:.0f} MB installed")

    def tried(name: str, *command: str) -> str:
        began = time.perf_counter()
        ran = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
        record_property(name, f"{time.perf_counter() - began:.1f} s")
        assert ran.returncode == 0, ran.stderr
        return ran.stdout

    clip = str(site / "stages/shared/clips/jump.bvh")
    code = (
        "import importlib.util, pathlib, sys, pumps\n"
        "assert pathlib.Path(pumps.__file__).is_relative_to(sys.argv[1]), pumps.__file__\n"
        "assert not importlib.util.find_spec('pytest')\n"
        "pumps.save(pumps.infill(pumps.load(sys.argv[2]), [0, 15, 40]), 'python.bvh')\n"
    )
    command = str(python.with_name("pumps"))
    tried("import pumps, fill and save", str(python), "-c", code, str(site), clip)
    tried("pumps infill", command, "infill", clip, "--keyframes", "0,15,40", "-o", "typed.bvh")
    told = tried("pumps doctor", command, "doctor")
    assert "MISSING" not in told and "small-free" in told
    assert (tmp_path / "typed.bvh").read_bytes() == (tmp_path / "python.bvh").read_bytes()
