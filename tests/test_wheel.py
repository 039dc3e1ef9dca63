"""The wheel holds all that pumps needs, and works away from the checkout."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("data_schemas", "pumps", "pumps_cli", "stages")
MOST_MB = 45


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy, since a build leaves a folder from which the next build takes files that are gone since."""
    source, built = (tmp_path_factory.mktemp(name) for name in ("source", "built"))
    for name in PACKAGES:
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE", "NOTICE"):
        shutil.copy(ROOT / name, source / name)
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*command, "--wheel-dir", str(built), str(source)], check=True, capture_output=True)
    return next(built.glob("pumps-*.whl"))


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


def test_the_wheel_is_small(wheel: Path) -> None:
    assert wheel.stat().st_size < MOST_MB * 1e6


def test_it_fills_a_clip_away_from_the_checkout(wheel: Path, tmp_path: Path) -> None:
    site = tmp_path / "site"
    zipfile.ZipFile(wheel).extractall(site)
    environment = {**os.environ, "PYTHONPATH": str(site), "OMP_NUM_THREADS": "1"}
    clip = site / "stages/shared/clips/jump.bvh"
    code = (
        "import pathlib, sys, pumps\n"
        "from pumps_cli.app import main\n"
        f"assert pathlib.Path(pumps.__file__).is_relative_to({str(site)!r}), pumps.__file__\n"
        f"motion = pumps.load({str(clip)!r})\n"
        "pumps.save(pumps.infill(motion, [0, 15, 40]), 'python.bvh')\n"
        f"for words in (['doctor'], ['infill', {str(clip)!r}, '--keyframes', '0,15,40', '-o', 'typed.bvh']):\n"
        "    try: main(words)\n"
        "    except SystemExit as leaving: assert not leaving.code, words\n"
    )
    ran = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    assert (tmp_path / "typed.bvh").read_bytes() == (tmp_path / "python.bvh").read_bytes()
