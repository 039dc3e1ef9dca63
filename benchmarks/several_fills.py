"""How different the fills of `pumps infill --samples` are, how near the best of them is, and how they move.

    python benchmarks/several_fills.py MOTION ... [--archives NAME ...] [--samples 5] [--windows 2] [--page FILE.md]

MOTION are motion artefacts (`pumps ingest`); windows of their clips of the split `test` are filled. Distances and
errors are means over the missing frames and the body's joints. Archives have the same weight.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from pathlib import Path

import numpy as np
from measuring.section import replace_section

from data_schemas.motion import ClipRow, MotionReader
from data_schemas.skeleton import Motion, Skeleton
from stages.infill.samples import distances_mm
from stages.shared.inference.cloud_sources import SynthesisedClouds
from stages.shared.inference.filled import Filled
from stages.shared.inference.filling import FillOptions, fill_motion
from stages.shared.inference.models import Models, load_weights
from stages.shared.inference.variation import variation_of
from stages.shared.inference.varied_fills import varied_fill
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.kinematics.resampling import resample
from stages.shared.statistics.archives import archive_of
from stages.shared.statistics.feel import TrueFeet, foot_skate_mps, jerk_mps3, true_feet
from stages.shared.statistics.tasks import INTERPOLATION, PREDICTION, TRANSITION
from stages.shared.statistics.windows import Task, chosen_windows, clip_windows
from stages.shared.weights.shipped import default_weights

TASKS = (
    Task(TRANSITION, 30, 121),
    Task(TRANSITION, 60, 121),
    Task(INTERPOLATION, 30, 121),
    Task(PREDICTION, 30, 121),
)
OPTIONS = FillOptions(foot_lock=True)
MARK = "several fills"
COLUMNS = ("usual_mm", "mean_mm", "best_mm", "apart_mm", "jerk", "skate", "usual_jerk", "usual_skate", "true_jerk",
           "true_skate")  # fmt: skip

Figures = dict[tuple[str, str], list[dict[str, float]]]  # task and archive -> those of each window


def fills_of(skeleton: Skeleton, truth: Motion, known: np.ndarray, models: Models, count: int) -> list[Filled]:
    """The usual fill, which reads the known frames alone, and then others."""
    source, coder, variation = SynthesisedClouds(models), models.autoencoder, variation_of(models)
    usual = fill_motion(skeleton, truth, known, source, device=coder.device, options=OPTIONS)
    return [
        usual,
        *(
            varied_fill(skeleton, usual, known, coder, variation, seeds=(0, number), options=OPTIONS)
            for number in range(2, count + 1)
        ),
    ]


def measured(skeleton: Skeleton, truth: Motion, known: np.ndarray, fills: list[Filled]) -> dict[str, float]:
    """The figures of one window's fills; those of movement are of all but the first, the usual one."""
    missing, body = ~known, skeleton.groups >= 0
    true = positions_of(skeleton, truth)
    feet = true_feet(skeleton, true[None])
    places = [positions_of(skeleton, fill.motion) for fill in fills]
    errors = [1000 * float(np.linalg.norm(each - true, axis=-1)[missing][:, body].mean()) for each in places]
    apart = distances_mm(skeleton, fills, np.flatnonzero(missing))
    moves = [_moves(each, feet, missing, body) for each in places]
    true_jerk, true_skate = _moves(true, feet, missing, body)
    return {
        "usual_mm": errors[0],
        "mean_mm": float(np.mean(errors[1:])),
        "best_mm": min(errors),
        "apart_mm": float(apart[np.triu_indices(len(fills), 1)].mean()),
        "jerk": float(np.mean([jerk for jerk, _ in moves[1:]])),
        "skate": float(np.mean([skate for _, skate in moves[1:]])),
        "usual_jerk": moves[0][0],
        "usual_skate": moves[0][1],
        "true_jerk": true_jerk,
        "true_skate": true_skate,
    }


def _moves(places: np.ndarray, feet: TrueFeet | None, missing: np.ndarray, body: np.ndarray) -> tuple[float, float]:
    jerk = float(jerk_mps3(places[None][:, :, body], missing)[0])
    if feet is None:
        return jerk, float("nan")
    return jerk, float(foot_skate_mps(places[None][:, :, feet.joints], feet.contacts, missing)[0])


def measure(paths: list[Path], models: Models, chosen: list[str], count: int, most: int) -> Figures:
    """Windows of all artefacts; `chosen` archives, or all where none is named."""
    found: Figures = defaultdict(list)
    for path in paths:
        with MotionReader(path) as reader:
            archives: dict[str, list[ClipRow]] = defaultdict(list)
            for row in reader.clips:
                if row.split == "test" and (not chosen or archive_of(row) in chosen):
                    archives[archive_of(row)].append(row)
            for archive, rows in sorted(archives.items()):
                for task in TASKS:
                    windows = [clip_windows(row.clip, int(row.seconds * MODEL_FPS), task) for row in rows]
                    for window in chosen_windows(windows, most):
                        row = reader.row(window.clip)
                        truth = resample(reader.motion(row.clip), MODEL_FPS).at(window.span)
                        skeleton, known = reader.skeleton(row.skeleton), task.known(truth.frames)
                        fills = fills_of(skeleton, truth, known, models, count)
                        name = f"{task.name} {task.interval}"
                        found[name, archive].append(measured(skeleton, truth, known, fills))
                    print(f"{archive}, {task.name} {task.interval}: done", flush=True)
    return found


def table(found: Figures, count: int) -> str:
    """The figures as markdown, means over archives."""
    lines = [
        f"| task | usual, mm | others, mm | best of {count}, mm | apart, mm | jerk, m/s³ (usual, true) "
        "| foot skate, m/s (usual, true) |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for task in dict.fromkeys(task for task, _ in found):
        archives = [rows for (name, _), rows in found.items() if name == task]
        of = {name: np.nanmean([_mean(rows, name) for rows in archives]) for name in COLUMNS}
        lines.append(
            f"| {task} | {of['usual_mm']:.1f} | {of['mean_mm']:.1f} | {of['best_mm']:.1f} | "
            f"{of['apart_mm']:.1f} | {of['jerk']:.0f} ({of['usual_jerk']:.0f}, {of['true_jerk']:.0f}) | "
            f"{of['skate']:.3f} ({of['usual_skate']:.3f}, {of['true_skate']:.3f}) |"
        )
    windows = sum(len(rows) for rows in found.values())
    archives = sorted({archive for _, archive in found})
    return "\n".join([*lines, "", f"{windows} windows of {', '.join(archives)}."])


def _mean(rows: list[dict[str, float]], name: str) -> float:
    values = [row[name] for row in rows if np.isfinite(row[name])]
    return float(np.mean(values)) if values else float("nan")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("motion", nargs="+", type=Path)
    parser.add_argument("--archives", nargs="*", default=[], help="those to measure; all by default")
    parser.add_argument("--samples", type=int, default=5)
    parser.add_argument("--windows", type=int, default=2, help="of each archive and task")
    parser.add_argument("--weights", default=default_weights())
    parser.add_argument("--page", type=Path, help="page whose section gets the table")
    given = parser.parse_args()
    models = load_weights(given.weights)
    found = measure(given.motion, models, given.archives, given.samples, given.windows)
    text = table(found, given.samples)
    print(text)
    if given.page:
        replace_section(given.page, MARK, text)


if __name__ == "__main__":
    main()
