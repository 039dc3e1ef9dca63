"""How much `pumps weights adapt` gains: from half of a family's recordings to the other half.

    python benchmarks/adapting.py FAMILY=ARCHIVE[:PATTERN] ... [--minutes 10 | --steps 500] [--page docs/results.md]

A family is an archive or folder, or its recordings whose names match a pattern such as '*/29/*'. Every second one is
given to `pumps weights adapt`; windows of the others are filled with the weights before and after, and measured as a
share of slerp's L2P. Figures of a family that was measured before from the same weights are replaced.
"""

from __future__ import annotations

import argparse
import json
import time
from fnmatch import fnmatch
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from measuring.section import replace_section

from data_schemas.errors import UsageError
from stages.shared.formats.readers import AUTO, suffixes_of
from stages.shared.formats.sources import find_sources
from stages.shared.inference.models import load_weights
from stages.shared.progress import SILENT
from stages.shared.weights.shipped import default_weights
from stages.weights.adapt.choosing import Errors
from stages.weights.adapt.clips import read_clips
from stages.weights.adapt.config import Config
from stages.weights.adapt.holding_out import Part
from stages.weights.adapt.measuring import TASKS, measure, slerp_errors, windows_of
from stages.weights.adapt.run import run

MARK = "adapting"
NAMES = [f"{task.name} {task.interval}" for task in TASKS]


def halves(text: str) -> tuple[str, list[str], list[str]]:
    """The family's name, and the names of the recordings of each half."""
    family, equals, place = text.partition("=")
    archive, _, pattern = place.partition(":")
    names = sorted(source.name for source in find_sources([archive], suffixes_of(AUTO)))
    names = [name for name in names if fnmatch(name, pattern or "*")]
    if not equals or len(names) < 2:
        raise UsageError(f"{text!r} is no FAMILY=ARCHIVE[:PATTERN] of two recordings or more.")
    return family, names[::2], names[1::2]


def adapted(text: str, given: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Adapt to one half of a family, and measure before and after on the other."""
    family, mine, others = halves(text)
    output = folder / family
    clips = read_clips(Config.model_validate({"clips": tuple(others), "output": output}), SILENT).clips
    parts = [Part(index, 0, clip.motion.frames, held_out=True) for index, clip in enumerate(clips)]
    windows = windows_of(clips, parts, given.windows)
    spans, tasks = (np.array([getattr(window, name) for window in windows]) for name in ("span", "task"))
    if len(np.unique(spans)) < 2:
        raise UsageError(
            f"The other half of {family} has one stretch to measure.", "Give longer recordings, or more."
        )
    errors = Errors(spans, tasks, slerp_errors(windows))
    settings = {"weights": given.weights, "steps": given.steps, "minutes": given.minutes, "seed": given.seed}
    began = time.process_time()
    report = run(Config.model_validate({"clips": tuple(mine), "output": output, **settings}), progress=SILENT)
    spent = time.process_time() - began
    print("\n".join(report.lines), flush=True)
    filled = [
        measure(load_weights(source), windows, given.seed, lambda: None).as_they_are
        for source in (given.weights, output)
    ]
    gains = errors.gains(*filled)
    return {
        "family": family,
        "weights": given.weights,
        "clips": len(mine),
        "steps": report.figures["steps"],
        "cpu_minutes": spent / 60,
        "kept": report.figures["kept"],
        "confidence_fitted": report.figures["confidence_fitted"],
        "held_out": (report.figures["before"], report.figures["after"]),
        "ratios": [{NAMES[task]: ratio for task, ratio in errors.ratios(each).items()} for each in filled],
        "scores": [errors.score(each) for each in filled],
        "gain": float(gains.mean()),
        "standard_error": float(gains.std(ddof=1) / np.sqrt(len(gains))),
        "windows": len(windows),
    }


def tables(found: list[dict[str, Any]]) -> str:
    """The figures as Markdown: a table for each weights at the start, with the last figures of each family."""
    kept = {(each["family"], each["weights"]): each for each in found}
    names = dict.fromkeys(weights for _, weights in kept)
    return "\n\n".join(table([each for each in kept.values() if each["weights"] == name], name) for name in names)


def table(found: list[dict[str, Any]], weights: str) -> str:
    """The figures of families from some weights."""
    lines = [
        f"L2P as a share of slerp's on the half that was not adapted to, before and after `pumps weights adapt` from "
        f"`{weights}`.",
        "",
        f"| family | clips | CPU minutes | {' | '.join(NAMES)} | mean | gain | kept |",
        f"|---|---:|---:|{'---:|' * (len(NAMES) + 2)}---|",
    ]
    for each in found:
        before, after = each["ratios"]
        cells = [f"{before[name]:.3f} → {after[name]:.3f}" if name in before else "" for name in NAMES]
        mean = " → ".join(f"{score:.3f}" for score in each["scores"])
        gain = f"{each['gain']:.3f} ± {each['standard_error']:.3f}"
        what = f"{each['kept']}{' with its confidence fitted anew' if each['confidence_fitted'] else ''}"
        lines.append(
            f"| {each['family']} | {each['clips']} | {each['cpu_minutes']:.1f} | {' | '.join(cells)} | {mean} "
            f"| {gain} | {what} |"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("families", nargs="*", help="none writes the figures of earlier calls alone")
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--steps", type=int, default=0)
    parser.add_argument("--windows", type=int, default=16, help="spans of the other half, with all tasks in each")
    parser.add_argument("--weights", default=default_weights())
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="folder for the adapted weights; by default they are removed")
    parser.add_argument("--figures", type=Path, help="JSON file of figures, to which those of this call are added")
    parser.add_argument("--page", type=Path, help="page whose section gets the table")
    given = parser.parse_args()
    known = json.loads(given.figures.read_text()) if given.figures and given.figures.is_file() else []
    with TemporaryDirectory() as folder:
        for family in given.families:
            known.append(adapted(family, given, given.keep or Path(folder)))
            if given.figures:
                given.figures.write_text(json.dumps(known, indent=1) + "\n")
    text = tables(known)
    print(text)
    if given.page:
        replace_section(given.page, MARK, text)


if __name__ == "__main__":
    main()
