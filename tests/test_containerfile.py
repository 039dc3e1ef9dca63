"""The Containerfile by its lines; no image is built here."""

from __future__ import annotations

import json
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TEXT = re.sub(r"^#.*\n", "", (ROOT / "Containerfile").read_text(), flags=re.M)
LINES = [re.sub(r"\s+", " ", line) for line in TEXT.replace("\\\n", "").splitlines() if line.strip()]
RUNS = [line for line in LINES if line.startswith("RUN ")]


def _of(word: str) -> list[str]:
    return [line.partition(" ")[2] for line in LINES if line.startswith(f"{word} ")]


def test_the_base_is_a_fixed_release_of_debian():
    assert len(_of("FROM")) == 1 and re.fullmatch(r"debian:\d+\.\d+-slim", _of("FROM")[0])
    assert "latest" not in TEXT


def test_packages_come_from_debian_the_cpu_build_of_torch_and_the_wheel():
    hosts = re.findall(r"https?://([^/\s]+)", TEXT)
    assert hosts == ["download.pytorch.org"] and "whl/cpu" in TEXT
    (apt,) = (line for line in RUNS if "apt-get install" in line)
    assert (
        "--yes --no-install-recommends" in apt
        and "apt-get update" in apt
        and apt.endswith("rm -rf /var/lib/apt/lists/*")
    )
    installs = re.findall(r"pip install [^&]*", TEXT.replace("\\\n", ""))
    assert len(installs) == 2 and all("--no-cache-dir -c /opt/wheel/constraints.txt" in each for each in installs)
    assert "--extra-index-url" not in TEXT and "trusted-host" not in TEXT and "ENV" not in TEXT


def test_commands_run_as_a_user_without_rights():
    user = LINES.index("USER 1000")
    assert any("useradd --create-home --uid 1000" in line for line in RUNS)
    assert max(LINES.index(line) for line in RUNS) < user < LINES.index(f"ENTRYPOINT {_of('ENTRYPOINT')[0]}")
    assert json.loads(_of("ENTRYPOINT")[0]) == ["/opt/pumps/bin/pumps"] and json.loads(_of("CMD")[0]) == ["--help"]


def test_the_image_is_sent_what_it_copies_and_nothing_else():
    *copied, _ = _of("COPY")[0].split()
    sent = (ROOT / ".dockerignore").read_text().split()
    assert sent == ["*", *(f"!{each}" for each in copied)] and len(_of("COPY")) == 1
    assert (ROOT / "constraints.txt").is_file()
