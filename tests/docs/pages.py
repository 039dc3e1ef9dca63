"""The pages of the project, and the commands that stand in them."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    *(ROOT / f"{name}.md" for name in ("README", "CHANGELOG", "CONTRIBUTING", "SECURITY")),
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "papers").glob("*.md")),
    *sorted((ROOT / "docs" / "readers").glob("*.md")),
]


def blocks(language: str) -> list[tuple[Path, str]]:
    """The fenced blocks of a language, with the page of each."""
    fence = re.compile(rf"^ *```{language}\n(.*?)^ *```", re.M | re.S)  # a list's blocks are indented
    return [(page, block) for page in PAGES for block in fence.findall(page.read_text(encoding="utf-8"))]


LAUNCHED = re.compile(r"^(torchrun|accelerate launch) (.*?--no[-_]python) pumps ")


def commands() -> list[tuple[Path, str]]:
    """The lines of all ```sh blocks, continued lines joined, comments and launchers left out."""
    found = []
    for page, block in blocks("sh"):
        for line in block.replace("\\\n", " ").splitlines():
            line = line.partition(" #")[0].strip()
            if line and not line.startswith("#"):
                found.append((page, LAUNCHED.sub("pumps ", line)))
    return found


def launchers() -> list[tuple[str, list[str]]]:
    """The launchers that stand before commands, with their flags."""
    lines = [line for _, block in blocks("sh") for line in block.replace("\\\n", " ").splitlines()]
    return [(found[1], found[2].split()) for line in lines if (found := LAUNCHED.match(line.strip()))]
