"""How often a body is found on a rig whose names are gone: body groups against those that the names told.

    python benchmarks/any_humanoid.py [ARCHIVE ...] [--most N] [--page docs/formats.md]

Rigs are those that the tests write down in the manner of the usual tools, moved by an embedded clip, and those of the
BVH in the archives, moved by their own clips (`--most` of each archive, evenly chosen). Each is changed in one way,
then in all at once; a clip counts where every joint's group and the pelvis are the same as before.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from measuring.section import replace_section

from data_schemas.errors import InputError
from data_schemas.skeleton import Skeleton
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import rig_and_poses
from stages.shared.formats.source_body import SourcePoses, SourceRig, body_of, motion_of_poses
from stages.shared.formats.sources import find_sources
from stages.shared.humanoid.anatomy import parts_of_skeleton
from stages.shared.humanoid.facing import SIGNS, BodyPoses, bone_tips, find_facing
from stages.shared.kinematics.forward_numpy import positions_of

sys.path.append(str(Path(__file__).parents[1]))  # for the rigs and changes of the tests
from tests.shared.humanoid.rig_changes import changed
from tests.shared.humanoid.written_rigs import WRITTEN, written_rig

SECTION = "any-humanoid"
CHANGES = ("names", "lengths", "order", "world", "axes", "all", "one frame")
HEADS = (
    "names gone", "and lengths ±15%", "and order shuffled", "and world turned", "and local axes turned",
    "all of these", "names gone, one frame",
)  # fmt: skip
MOST_FRAMES = 1500


def rigs(archives: list[str], most: int) -> Iterator[tuple[str, SourceRig, SourcePoses]]:
    """(set, rig, poses) of every clip that is looked at."""
    for name in WRITTEN:
        written = written_rig(name)
        yield "written down", written.rig, written.poses
    clips = Path(__file__).parents[1] / "stages" / "shared" / "clips"
    for archive in (str(clips), *archives):
        found = find_sources([archive])
        for source in [found[i] for i in np.unique(np.linspace(0, len(found) - 1, most).astype(int))]:
            bvh = read_bvh(source.read(), source.name)
            bvh = bvh.select(np.arange(min(1, bvh.frames - 1), min(bvh.frames, MOST_FRAMES)))
            label = "embedded clips" if archive == str(clips) else Path(archive).name
            yield label, *rig_and_poses(bvh)


def one_frame(poses: SourcePoses) -> SourcePoses:
    """The frame midway alone."""
    at = slice(len(poses.local) // 2, len(poses.local) // 2 + 1)
    tracks = poses.tracks[at] if len(poses.moving) else poses.tracks
    return replace(poses, local=poses.local[at], root=poses.root[at], tracks=tracks)


def is_found(named: Skeleton, rig: SourceRig, poses: SourcePoses, change: str, seed: int) -> bool:
    """Whether the changed rig has the groups that the names told."""
    poses = one_frame(poses) if change == "one frame" else poses
    rig, poses, order = changed(rig, poses, change, np.random.default_rng(seed))
    try:
        found = motion_of_poses(body_of(rig), poses)[0]
    except InputError:
        return False
    return bool((found.groups == named.groups[order]).all() and order[found.root] == named.root)


def signs_of(rig: SourceRig, poses: SourcePoses) -> dict[str, float]:
    """What each sign of facing says on its own of a clip whose sides the names tell: positive is right."""
    skeleton, motion, _ = motion_of_poses(body_of(rig), poses)
    step = max(1, round(0.2 * motion.fps))
    places = positions_of(skeleton, motion)[::step]
    tips = bone_tips(
        places, motion.rotations[::step].astype(float), skeleton.tails, np.linalg.norm(skeleton.tails, axis=1) > 0
    )
    facing = find_facing(BodyPoses(places, tips, step / motion.fps), parts_of_skeleton(skeleton)[0])
    return facing.signs


def tables(archives: list[str], most: int) -> str:
    """Both tables in Markdown."""
    right: dict[str, Counter[str]] = defaultdict(Counter)
    clips: Counter[str] = Counter()
    votes: dict[str, list[float]] = defaultdict(list)
    for seed, (label, rig, poses) in enumerate(rigs(archives, most)):
        named = motion_of_poses(body_of(rig), poses)[0]
        clips[label] += 1
        for change in CHANGES:
            right[label][change] += is_found(named, rig, poses, change, seed)
        for sign, value in signs_of(rig, poses).items():
            votes[sign].append(value)
    lines = [f"| rigs | clips | {' | '.join(HEADS)} |", f"|---|{'---:|' * (len(HEADS) + 1)}"]
    for label, count in clips.items():
        lines.append(f"| {label} | {count} | {' | '.join(str(right[label][change]) for change in CHANGES)} |")
    lines += ["", "| sign, alone | says right | says nothing | says wrong |", "|---|---:|---:|---:|"]
    for sign in SIGNS:
        values = np.array(votes[sign])
        shares = [(values > 0.02).mean(), (np.abs(values) <= 0.02).mean(), (values < -0.02).mean()]
        lines.append(f"| {sign} | {' | '.join(f'{share:.1%}' for share in shares)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("archives", nargs="*", help="zip archives or folders of BVH")
    parser.add_argument("--most", type=int, default=100, help="clips of each archive")
    parser.add_argument("--page", type=Path, help="page whose section to write")
    arguments = parser.parse_args()
    made = tables(arguments.archives, arguments.most)
    print(made)
    if arguments.page:
        replace_section(arguments.page, SECTION, made)
