"""Stands in for `pumps` in tests of the makefile: settings are written for real, stages only leave their target.

LOG names the file that keeps which stages ran; FAIL names a stage that leaves with an error instead.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from stages.registry import STAGES


def leave_target(words: list[str]) -> None:
    """What the stage would write, but empty."""
    stage = next(each for each in STAGES if tuple(words[: len(each.command)]) == each.command)
    with open(os.environ["LOG"], "a") as log:
        log.write(stage.name + "\n")
    if os.environ.get("FAIL") == stage.name:
        sys.exit(1)
    settings = Path(words[words.index("--config") + 1]).read_text()
    assert settings.startswith(f"# Settings of `pumps {' '.join(stage.command)}`."), "another stage's settings"
    if "-o" not in words:
        return _write(Path(words[len(stage.command)]) / "confidence.json")  # weights calibrate
    output = Path(words[words.index("-o") + 1])
    if stage.writes_file:
        return _write(output)
    _write(output / stage.target)
    if stage.name == "data-pick":
        for name in ("one", "two"):
            _write(output / f"{name}.bvh")
    if "--made" in words and stage.name == "measure-solve":
        for name in ("truth", "network"):
            _write(Path(words[words.index("--made") + 1]) / "rig" / name / "manifest.json")


def _write(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("whole")


if __name__ == "__main__":
    if sys.argv[1] == "config":
        from pumps_cli.app import main  # only here: a stage that does nothing should cost nothing

        main()
    elif sys.argv[1] != "results":
        leave_target(sys.argv[1:])
