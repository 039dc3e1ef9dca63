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
    output = Path(words[words.index("-o") + 1])
    for word in words:
        if word.startswith("--config"):
            assert Path(words[words.index(word) + 1]).stem == stage.name
    if stage.name == "data-pick":
        output.mkdir(parents=True, exist_ok=True)
        for name in ("one", "two"):
            (output / f"{name}.bvh").write_text("HIERARCHY")
        (output / "clips.txt").write_text("one.bvh\ntwo.bvh\n")
    elif output.suffix:
        output.write_text("whole")
    else:
        output.mkdir(parents=True, exist_ok=True)
        (output / "manifest.json").write_text("{}")


if __name__ == "__main__":
    if sys.argv[1] == "config":
        from pumps_cli.app import main  # only here: a stage that does nothing should cost nothing

        main()
    elif sys.argv[1] != "results":
        leave_target(sys.argv[1:])
