"""What holding the feet does to legs: pops, skate and error of filled windows, loose and held, beside the truth's.

    python benchmarks/held_feet.py [ARCHIVE ...] [--most 5] [--weights small-free] [--keep FOLDER]

Without archives: the embedded clips, and every archive in ../shared/data that is there. Of each archive `--most`
clips, evenly chosen, one window of each, are filled with keys every 15 and every 30 frames and as a transition of 30.
The networks run once for each window. With `--keep` their fills are stored there and read again by the next run, so
that a change of the foot lock alone is measured in a minute.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from data_schemas.manifest import open_artefact
from data_schemas.motion import MotionReader
from data_schemas.skeleton import Motion, Skeleton
from stages.evaluate.methods import without_answers
from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest
from stages.shared.formats.readers import AUTO, suffixes_of
from stages.shared.formats.sources import find_sources
from stages.shared.inference.cloud_sources import SynthesisedClouds
from stages.shared.inference.filling import fill_motion
from stages.shared.inference.foot_lock import lock_feet
from stages.shared.inference.models import Models, load_weights
from stages.shared.inference.pop_limits import ROUNDING
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.foot_contacts import has_feet
from stages.shared.kinematics.resampling import resample, resampled_frames
from stages.shared.solve.skeleton_pose import SkeletonPose
from stages.shared.statistics.archives import archive_of
from stages.shared.statistics.baselines import BASELINES, Poses
from stages.shared.statistics.feel import feel, true_feet
from stages.shared.statistics.measurements import Truth, measured_joints
from stages.shared.statistics.metrics import l2p_m
from stages.shared.statistics.tasks import INTERPOLATION, TRANSITION
from stages.shared.statistics.windows import Task, chosen_windows, clip_windows

ROOT = Path(__file__).resolve().parents[1]
CLIPS, DATA = ROOT / "stages" / "shared" / "clips", ROOT.parent / "shared" / "data"
NEEDS_MORE = ("action2motion-samples.zip",)  # joint positions, which need a skeleton that is named
TASKS = (Task(INTERPOLATION, 15, 121), Task(INTERPOLATION, 30, 121), Task(TRANSITION, 30, 121))
HELD, LOOSE, TRUE = "held", "loose", "truth"
# A held leg counts as worse than a loose one if the figure is larger by more than the rounding of float32 poses.
ROUNDED = {
    "largest_turn_deg": np.degrees(ROUNDING),
    "largest_acceleration_mps2": MODEL_FPS**2 * ROUNDING,
}
Figures = dict[str, float]


@dataclass(frozen=True)
class Case:
    """A true window of one clip at 30 frames a second, and which of its frames are known."""

    name: str
    task: Task
    skeleton: Skeleton
    truth: Motion
    known: np.ndarray

    def loose(self, models: Models, keep: Path | None) -> Motion:
        """The window as the networks fill it, before its feet are held."""
        stored = keep / f"{self.name}.npz".replace("/", "_") if keep else None
        if stored and stored.exists():
            with np.load(stored) as kept:
                return Motion(kept["rotations"], kept["roots"], MODEL_FPS, kept["joints"], kept["tracks"])
        given = without_answers(self.truth, self.known)
        made = fill_motion(self.skeleton, given, self.known, SynthesisedClouds(models)).motion
        if stored:
            stored.parent.mkdir(parents=True, exist_ok=True)
            np.savez(
                stored,
                rotations=made.rotations,
                roots=made.root_positions,
                joints=made.track_joints,
                tracks=made.tracks,
            )
        return made

    def held(self, loose: Motion) -> Motion:
        """The same with its feet held."""
        return lock_feet(SkeletonPose.of_motion(self.skeleton, loose), self.known, MODEL_FPS).motion(MODEL_FPS)

    def figures(self, filled: dict[str, Motion]) -> dict[str, Figures]:
        """Figures of the filled motions, and of the truth, by their names."""
        true = Poses.of(self.skeleton, [self.truth])
        truth = Truth(true.positions.numpy(), true.rotations.numpy(), self.known, self.skeleton.root)
        joints, feet = measured_joints(self.skeleton), true_feet(self.skeleton, truth.positions)
        slerp = l2p_m(BASELINES["slerp"](true, self.known)[0][:, :, joints], truth.positions[:, :, joints])[0]
        found: dict[str, Figures] = {}
        for name, motion in ({TRUE: self.truth} | filled).items():
            poses = Poses.of(self.skeleton, [motion])
            places, rotations = poses.positions.numpy(), poses.rotations.numpy()
            felt = feel(places, rotations, truth, joints, feet)
            error = l2p_m(places[:, :, joints], truth.positions[:, :, joints])[0]
            found[name] = {metric: float(values[0]) for metric, (values, _) in felt.items()}
            found[name] |= {"l2p_share": error / max(slerp, 1e-9)}
        return found


def cases(archives: list[str], most: int, folder: Path) -> Iterator[Case]:
    """The windows of all archives and tasks."""
    names: list[str] = []
    for archive in archives:
        found = find_sources([archive], suffixes_of(AUTO))
        picks = np.unique(np.linspace(0, len(found) - 1, 2 * most).astype(int))
        names += [found[pick].name for pick in picks]
    ingest(IngestConfig.model_validate({"sources": tuple(names), "output": folder, "workers": 1}))
    with MotionReader(open_artefact(folder, "motion")) as reader:
        motion_of = cache(lambda clip: resample(reader.motion(clip), MODEL_FPS))
        for archive in dict.fromkeys(archive_of(row) for row in reader.clips):
            rows = [row for row in reader.clips if archive_of(row) == archive]
            rows = [row for row in rows if has_feet(reader.skeleton(row.skeleton))]
            frames = {row.clip: resampled_frames(row.frames, row.fps, MODEL_FPS) for row in rows}
            skeletons = {row.clip: reader.skeleton(row.skeleton) for row in rows}
            for task in TASKS:
                long = [windows for clip in frames if (windows := clip_windows(clip, frames[clip], task))]
                for window in chosen_windows(long, min(most, len(long))):
                    name = f"{archive} {window.clip} {window.start} {task.name} {task.interval}"
                    truth = motion_of(window.clip).at(window.span)
                    yield Case(name, task, skeletons[window.clip], truth, task.known(window.frames))


def table(measured: list[tuple[Case, dict[str, Figures]]]) -> str:
    """Markdown: for each task, and for all, a row for the truth, the loose fills and the held ones."""
    heads = (
        "L2P/slerp", "skate mm/s", "floating mm", "sunk mm", "jerk/truth", "twists", "jolts", "turn > loose",
        "acc. > loose", "crossing frames",
    )  # fmt: skip
    lines = [f"| task | fill | windows | {' | '.join(heads)} |", f"|---|---|---:|{'---:|' * len(heads)}"]
    for task in (*TASKS, None):
        here = [figures for case, figures in measured if task in (case.task, None)]
        label = f"{task.name} {task.interval}" if task else "all"
        for name in (TRUE, LOOSE, HELD):
            rows = [figures[name] for figures in here]
            loose = [figures[LOOSE] for figures in here]
            truth = [figures[TRUE] for figures in here]
            cells = [
                f"{np.mean([row['l2p_share'] for row in rows]):.3f}",
                f"{1000 * np.nanmean([row['foot_skate_mps'] for row in rows]):.0f}",
                f"{np.nanmean([row['floating_mm'] for row in rows]):.1f}",
                f"{np.nanmean([row['floor_penetration_mm'] for row in rows]):.1f}",
                f"{np.mean(_column(rows, 'jerk_mps3') / np.maximum(_column(truth, 'jerk_mps3'), 1e-9)):.2f}",
                *(f"{sum(row[share] for row in rows):.0f}" for share in ("twist_share", "jolt_share")),
                *(str(_worse(rows, loose, metric)) for metric in ROUNDED),
                f"{sum(row['crossing_frames'] for row in rows):.0f}",
            ]
            lines.append(f"| {label} | {name} | {len(rows)} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _column(rows: list[Figures], metric: str) -> np.ndarray:
    return np.array([row[metric] for row in rows])


def _worse(rows: list[Figures], loose: list[Figures], metric: str) -> int:
    """Number of windows in which a figure is larger than in the loose fill."""
    return sum(row[metric] > other[metric] + ROUNDED[metric] for row, other in zip(rows, loose, strict=True))


def worst(measured: list[tuple[Case, dict[str, Figures]]], count: int = 8) -> list[str]:
    """The windows in which the held fill turns or accelerates most beyond the truth and the loose fill."""
    lines = []
    for metric in ROUNDED:
        ranked = sorted(measured, key=lambda each: -each[1][HELD][metric] / max(
            each[1][TRUE][metric], each[1][LOOSE][metric], 1.0))  # fmt: skip
        for case, figures in ranked[:count]:
            values = ", ".join(f"{name} {figures[name][metric]:.1f}" for name in (HELD, LOOSE, TRUE))
            lines.append(f"{metric}: {case.name}: {values}")
    return lines


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("archives", nargs="*", help="archives or folders of recordings")
    parser.add_argument("--most", type=int, default=5, help="clips of each archive")
    parser.add_argument("--weights", default="small-free", help="weights that fill")
    parser.add_argument("--keep", type=Path, help="folder of fills to read and to write")
    arguments = parser.parse_args()
    found = [str(path) for path in sorted(DATA.glob("*.zip")) if path.name not in NEEDS_MORE]
    archives = arguments.archives or [str(CLIPS), *found]
    models = load_weights(arguments.weights, "cpu")
    keep = arguments.keep / arguments.weights if arguments.keep else None
    measured = []
    with tempfile.TemporaryDirectory(prefix="pumps-") as scratch:
        for case in cases(archives, arguments.most, Path(scratch) / "motion"):
            loose = case.loose(models, keep)
            measured.append((case, case.figures({LOOSE: loose, HELD: case.held(loose)})))
    print(table(measured))
    print("\n".join(["", *worst(measured)]))


if __name__ == "__main__":
    main()
