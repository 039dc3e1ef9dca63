"""Euler channels of filled BVH files that jump by more than 180 degrees where the recording's do not.

    python benchmarks/euler_flips.py [ARCHIVE ...] [--most 5] [--every 5 15 30] [--weights NAME] [--show]

Without archives: the embedded clips, and each archive in ../shared/data that holds BVH files. Of each, `--most`
clips, evenly chosen, ten seconds from the middle of each, are filled with a key every 5, 15 and 30 frames at
30 frames a second, by plain interpolation, or with `--weights` by networks; the rows are written as `pumps infill`
writes them. A place is a joint in a gap: one of its channels jumps there, and none does in the recording.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.bvh import BvhFile, read_bvh
from stages.shared.formats.bvh_motion import motion_of, rate_of
from stages.shared.formats.bvh_rows import layout_of
from stages.shared.formats.euler_path import JUMP_DEGREES
from stages.shared.formats.euler_rows import rows_between_keys
from stages.shared.formats.sources import find_sources
from stages.shared.inference.cloud_sources import SynthesisedClouds
from stages.shared.inference.filling import fill_motion
from stages.shared.inference.models import Models, load_weights
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.plain_interpolation import damped_smoothness
from stages.shared.solve.skeleton_pose import SkeletonPose

ROOT = Path(__file__).resolve().parents[1]
CLIPS, DATA = ROOT / "stages" / "shared" / "clips", ROOT.parent / "shared" / "data"
SECONDS = 10.0


@dataclass
class Counts:
    """Of some fills: their number, their gaps, places that jump, and of those the ones that infill reports."""

    fills: int = 0
    gaps: int = 0
    places: int = 0
    told: int = 0

    def __add__(self, other: Counts) -> Counts:
        return Counts(*(one + two for one, two in zip(vars(self).values(), vars(other).values(), strict=True)))


def middle_of(bvh: BvhFile) -> BvhFile:
    """Ten seconds from the middle of a recording, or all of it."""
    frames = min(bvh.frames, round(SECONDS / bvh.frame_time))
    start = (bvh.frames - frames) // 2
    return bvh.select(np.arange(start, start + frames))


def filled_motion(skeleton: Skeleton, motion: Motion, known: np.ndarray, models: Models | None) -> Motion:
    """The motion with the frames that are not known filled, by networks or by their plain interpolation alone."""
    if models is not None:
        return fill_motion(skeleton, motion, known, SynthesisedClouds(models)).motion
    keys = np.flatnonzero(known)
    per_frame = MODEL_FPS / motion.fps
    key_times = torch.as_tensor(keys * per_frame)
    times = torch.as_tensor(np.arange(motion.frames) * per_frame)
    pose = SkeletonPose.of_motion(skeleton, motion).rows(keys).by_local()
    return pose.at(key_times, times, damped_smoothness(key_times, MODEL_FPS)).motion(motion.fps)


def jumps_of(bvh: BvhFile, values: np.ndarray, keys: np.ndarray) -> set[tuple[str, int]]:
    """(joint, gap) in which a rotation channel of rows (T, C) jumps; a gap is named by its first key."""
    found = set()
    steps = np.abs(np.diff(values, axis=0))
    for _, joints, columns in layout_of(bvh.joints).rotations:
        for joint, at in zip(joints, columns, strict=True):
            for frame in np.flatnonzero((steps[:, at] > JUMP_DEGREES).any(axis=1)):
                gap = int(np.searchsorted(keys, frame, side="right")) - 1
                found.add((bvh.joints[joint].name, gap))
    return found


def counts_of(bvh: BvhFile, every: int, models: Models | None) -> tuple[Counts, list[str]]:
    """The counts of one fill, and the places by name.

    Raises: InputError if the recording is no body, or is too short for a gap.
    """
    step = max(2, round(every * rate_of(bvh.frame_time) / MODEL_FPS))
    keys = np.arange(0, bvh.frames, step)
    if len(keys) < 2:
        raise InputError(f"{bvh.name} is shorter than a gap.")
    bvh = bvh.select(np.arange(keys[-1] + 1))
    key_skeleton, key_motion, _ = motion_of(bvh.select(keys))
    known = np.zeros(bvh.frames, bool)
    known[keys] = True
    spread = np.searchsorted(keys, np.arange(bvh.frames), side="right") - 1  # what is not known is the key before
    given = key_motion.at(spread)
    made = filled_motion(key_skeleton, given, known, models)
    values, jumps = rows_between_keys(bvh, key_skeleton, made, keys, bvh.values[keys])
    places = jumps_of(bvh, values, keys) - jumps_of(bvh, bvh.values, keys)
    told = {(jump.joint, int(np.searchsorted(keys, jump.frame, side="left")) - 1) for jump in jumps}
    named = [f"{bvh.name}, every {every}: {joint}, frames {keys[gap]} to {keys[gap + 1]}" for joint, gap in places]
    return Counts(1, len(keys) - 1, len(places), len(places & told)), sorted(named)


def main() -> None:
    """Count and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("archives", nargs="*", help="archives or folders of BVH files")
    parser.add_argument("--most", type=int, default=5, help="clips of each archive")
    parser.add_argument("--every", type=int, nargs="+", default=[5, 15, 30], help="frames from key to key")
    parser.add_argument("--weights", help="weights that fill; without them, plain interpolation")
    parser.add_argument("--show", action="store_true", help="print each place")
    arguments = parser.parse_args()
    models = load_weights(arguments.weights, "cpu") if arguments.weights else None
    rows: dict[str, Counts] = {}
    left_out: Counter[str] = Counter()
    for archive in arguments.archives or [str(CLIPS), *map(str, sorted(DATA.glob("*.zip")))]:
        try:
            found = find_sources([archive])
        except InputError:  # no BVH is in it
            continue
        name = "embedded clips" if archive == str(CLIPS) else Path(archive).name
        for pick in np.unique(np.linspace(0, len(found) - 1, arguments.most).astype(int)):
            try:
                bvh = middle_of(read_bvh(found[pick].read(), found[pick].name))
                fills = [counts_of(bvh, every, models) for every in arguments.every]
            except InputError:
                left_out[name] += 1
                continue
            for counts, named in fills:
                rows[name] = rows.get(name, Counts()) + counts
                if arguments.show and named:
                    print("\n".join(named))
    rows["all"] = sum(rows.values(), Counts())
    print("| recordings | fills | gaps | places | of them reported |", "|---|---:|---:|---:|---:|", sep="\n")
    for name, each in rows.items():
        print(f"| {name} | {each.fills} | {each.gaps} | {each.places} | {each.told} |")
    for name, count in left_out.items():
        print(f"left out: {count} clips of {name}, which are no bodies or shorter than a gap")


if __name__ == "__main__":
    main()
