"""What `pumps edit` does to real clips: mirror, resample, loop and join, beside the truth where there is one.

    python benchmarks/whole_files.py [ARCHIVE ...] [--most 4] [--weights NAME] [--page FILE.md]

Without archives: the families of ../shared/data below. Of each, `--most` clips, evenly chosen, up to six seconds from
the middle of each.

mirror:   distance of each joint from its partner's image, and of a motion mirrored twice from itself.
resample: every second frame is left out and made again; the error in the frames made, beside slerp.
loop:     the first three seconds; change of velocity at the seams (mean over the body's joints) over the clip's own,
          and the largest in the added frames over twice the clip's own (or what 95% of its frames have, if more).
join:     half a second in the middle is left out, and the second part is turned and shifted away. Measured: the
          distance and the turn from its true place after joining; the error of the filled frames beside plain
          interpolation; the changes of velocity as in a loop.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from pathlib import Path

import numpy as np
import torch
from measuring.section import replace_section

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.editing.bridging import SMOOTH_SEAM, joined, looped
from stages.shared.editing.mirror import mirror_of, mirrored
from stages.shared.editing.motion_files import motion_file
from stages.shared.editing.placing import Placement
from stages.shared.editing.timing import resampled
from stages.shared.formats.recording import Asked
from stages.shared.formats.sources import find_sources
from stages.shared.inference.kept_models import kept_models
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.kinematics.plain_interpolation import damped_smoothness
from stages.shared.solve.skeleton_pose import SkeletonPose

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
FAMILIES = ("bandai-namco-1", "bandai-namco-2", "cmu-asfamc", "cmu-dance", "hdm05", "lafan1-g1", "reactidle")
SECONDS, LOOP_S, GAP_S = 6.0, 3.0, 0.5
AWAY = Placement(2.0, np.zeros(3), np.array([3.0, 0.0, -5.0]))  # where the second part is put before it is joined

SECTION = "whole files"

Figures = dict[str, list[float]]


def clips_of(archive: Path, most: int) -> list[tuple[Skeleton, Motion]]:
    """Evenly chosen clips of an archive, the middle of each."""
    sources = find_sources([str(archive)], (".bvh", ".amc"))
    found = []
    for at in np.unique(np.linspace(0, len(sources) - 1, 4 * most).astype(int)):
        try:
            file = motion_file(sources[at], Asked())
        except InputError:
            continue
        frames = min(file.motion.frames, round(SECONDS * file.motion.fps))
        if frames < LOOP_S * file.motion.fps:
            continue
        start = (file.motion.frames - frames) // 2
        found.append((file.skeleton, file.motion.at(slice(start, start + frames))))
        if len(found) == most:
            break
    return found


def error_mm(skeleton: Skeleton, made: Motion, true: Motion) -> float:
    """Mean distance of the body's joints, millimetres."""
    body = skeleton.groups >= 0
    apart = positions_of(skeleton, made)[:, body] - positions_of(skeleton, true)[:, body]
    return 1000 * float(np.linalg.norm(apart, axis=-1).mean())


def plain(skeleton: Skeleton, motion: Motion, known: np.ndarray, smooth: float | None) -> Motion:
    """The unknown frames by plain interpolation of the known ones, with the known ones left out."""
    keys, gaps = (torch.as_tensor(np.flatnonzero(each), dtype=torch.float64) for each in (known, ~known))
    pose = SkeletonPose.of_motion(skeleton, motion).rows(np.flatnonzero(known)).by_local()
    per_frame = MODEL_FPS / motion.fps
    damped = damped_smoothness(keys * per_frame, MODEL_FPS) if smooth is None else smooth
    return pose.at(keys, gaps, damped).motion(motion.fps)


def measure(skeleton: Skeleton, motion: Motion, weights: str, out: Figures) -> None:
    """Add one clip's figures."""
    body = skeleton.groups >= 0
    mirror = mirror_of(skeleton, motion)
    once = mirrored(skeleton, motion, mirror)
    image = positions_of(skeleton, motion)[:, mirror.partner] * np.diag(mirror.world)
    out["mirror mm"].append(
        1000 * float(np.linalg.norm(positions_of(skeleton, once) - image, axis=-1)[:, body].mean())
    )
    out["twice mm"].append(error_mm(skeleton, mirrored(skeleton, once, mirror), motion))

    odd = motion.frames - 1 + motion.frames % 2
    whole, half = motion.at(slice(0, odd)), motion.at(slice(0, odd, 2))
    half = Motion(half.rotations, half.root_positions, motion.fps / 2, half.track_joints, half.tracks)
    made = resampled(skeleton, half, motion.fps)
    between = made.rows < 0
    true = whole.at(between)
    out["resample mm"].append(error_mm(skeleton, made.motion.at(between), true))
    out["slerp mm"].append(error_mm(skeleton, plain(skeleton, whole, ~between, 0.0), true))

    models = kept_models(weights, "cpu")
    loop = looped(skeleton, motion.at(slice(0, round(LOOP_S * motion.fps))), lambda: models)
    for name, ratio in zip(("loop seam", "loop within"), loop.seams.ratios, strict=True):
        out[name].append(ratio)
    out["loop s"].append(float(loop.edited.bridged.sum() / motion.fps))

    count = round(GAP_S * motion.fps)
    first, then = motion.frames // 2 - count // 2, motion.frames // 2 - count // 2 + count
    rest = motion.at(slice(then, None))
    join = joined(skeleton, motion.at(slice(0, first)), AWAY.of_motion(rest), lambda: models, seconds=GAP_S)
    put = join.edited.motion.at(slice(then, None))
    pelvis = [positions_of(skeleton, each)[0, skeleton.root] for each in (put, rest)]
    out["place cm"].append(100 * float(np.linalg.norm(pelvis[0] - pelvis[1])))
    turn = np.degrees(join.placement.yaw_rad + AWAY.yaw_rad)
    out["heading deg"].append(abs((turn + 180) % 360 - 180))
    known = np.ones(motion.frames, bool)
    known[first:then] = False
    true = motion.at(slice(first, then))
    out["filled mm"].append(error_mm(skeleton, join.edited.motion.at(slice(first, then)), true))
    out["plain mm"].append(error_mm(skeleton, plain(skeleton, join.edited.motion, known, None), true))
    for name, ratio in zip(("join seam", "join within"), join.seams.ratios, strict=True):
        out[name].append(ratio)


def main() -> None:
    """Print one row for each archive, and one for all clips; with --page, also write them into the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("archives", nargs="*", type=Path, default=[DATA / f"{name}.zip" for name in FAMILIES])
    parser.add_argument("--most", type=int, default=4)
    parser.add_argument("--weights", default="small-free")
    parser.add_argument("--page", type=Path, help="page whose section gets the table")
    given = parser.parse_args()
    total: Figures = defaultdict(list)
    rows: list[str] = []
    for archive in given.archives:
        out: Figures = defaultdict(list)
        for skeleton, motion in clips_of(archive, given.most):
            measure(skeleton, motion, given.weights, out)
        for name, values in out.items():
            total[name] += values
        rows.append(row_of(archive.name, out))
        print(rows[-1], flush=True)
    rows.append(row_of("all", total))
    head = ["archive", "clips", *total, f"seams under {SMOOTH_SEAM:g}"]
    table = "\n".join([f"| {' | '.join(head)} |", "|---" + "|---:" * (len(head) - 1) + "|", *rows])
    print(table)
    if given.page:
        replace_section(given.page, SECTION, table)


def row_of(name: str, out: Figures) -> str:
    """A row of means, and how many clips have seams under the limit of a smooth one, in loops and in joins."""
    if not out:
        return f"| {name} | 0 |"
    cells = " | ".join(f"{np.mean(values):.3g}" for values in out.values())
    good = [sum(value < SMOOTH_SEAM for value in out[f"{verb} seam"]) for verb in ("loop", "join")]
    clips = len(out["loop seam"])
    return f"| {name} | {clips} | {cells} | {good[0]} and {good[1]} of {clips} |"


if __name__ == "__main__":
    main()
