"""A virtual environment that holds what `pip install pumps` installs, and nothing else.

The distributions that pumps requires, and those that these require, are linked from the environment of the tests, so
that torch is not installed twice. What a test needs beside them (pytest, an optional extra) cannot be imported there.
"""

from __future__ import annotations

import importlib.metadata as metadata
import subprocess
import sys
import venv
from collections.abc import Iterator
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name


def make_environment(folder: Path, wheel: Path) -> Path:
    """Make the environment and install the wheel in it. Returns its python."""
    venv.create(folder, with_pip=False, symlinks=True)
    python = folder / "bin" / "python"
    site = next(folder.glob("lib/python*/site-packages"))
    for name in _closure(_requirements(wheel)):
        for path in _top_level(name):
            if not (site / path.name).exists():
                (site / path.name).symlink_to(path)
    command = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", "--no-deps", "--no-index"]
    subprocess.run([*command, str(wheel)], check=True, capture_output=True)
    return python


def installed_bytes(site: Path) -> tuple[int, int]:
    """Bytes of pumps, and of all that the environment holds beside it, through the links."""
    sizes = {entry: sum(_sizes(entry)) for entry in site.iterdir()}
    own = sum(size for entry, size in sizes.items() if not entry.is_symlink())
    return own, sum(sizes.values()) - own


def _sizes(path: Path) -> Iterator[int]:
    if path.is_file():
        yield path.stat().st_size
    elif path.name != "__pycache__":
        for entry in path.iterdir():
            yield from _sizes(entry)


def _requirements(wheel: Path) -> list[Requirement]:
    """What the wheel requires without extras."""
    (found,) = metadata.distributions(name="pumps", path=[str(wheel)])
    return _required(found, set())


def _required(found: metadata.Distribution, extras: set[str]) -> list[Requirement]:
    every = [Requirement(text) for text in found.requires or []]
    return [
        each
        for each in every
        if each.marker is None or any(each.marker.evaluate({"extra": extra}) for extra in {"", *extras})
    ]


def _closure(wanted: list[Requirement]) -> list[str]:
    """Names of the distributions that are wanted, and of all that these require."""
    seen: dict[str, set[str]] = {}
    while wanted:
        each = wanted.pop()
        name = canonicalize_name(each.name)
        if name in seen and each.extras <= seen[name]:
            continue
        seen[name] = seen.get(name, set()) | each.extras
        wanted += _required(metadata.distribution(name), seen[name])
    return sorted(seen)


def _top_level(name: str) -> list[Path]:
    """The files and folders of a distribution that lie in site-packages itself."""
    found = metadata.distribution(name)
    site = Path(str(found.locate_file("")))
    names = {path.parts[0] for path in found.files or ()}
    return [site / each for each in sorted(names) if each not in ("..", "__pycache__")]
