"""How often a body that is found is right: the shares that `pumps inspect` prints as "sure".

    python benchmarks/body_certainty.py [ARCHIVE ...] [--most N] [--page docs/evaluation.md]

Looked at: people's rigs (those that the tests write down, the embedded clips', and those of the archives, `--most`
clips of each) and creatures that are no people (made by the tests' code), each with its names, and with names j0, j1,
... in three ways: as it is, with joints in another order, and with lengths, axes and world changed too. A body is
right where every joint's group and the pelvis are those that the names tell; a creature taken for a person is wrong.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from measuring.section import replace_section

from data_schemas.errors import InputError
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import rig_and_poses
from stages.shared.formats.bvh_of_motion import bvh_of_motion
from stages.shared.formats.readers import read_recordings, recognise
from stages.shared.formats.recording import Asked
from stages.shared.formats.source_body import SourcePoses, SourceRig, body_of, motion_of_poses
from stages.shared.formats.sources import Source, find_sources
from stages.shared.humanoid.certainty import SURE_BY_SHAPE

sys.path.append(str(Path(__file__).parents[1]))  # for the rigs, creatures and changes of the tests
from tests.shared.humanoid.creatures import CREATURES, creature
from tests.shared.humanoid.rig_changes import changed
from tests.shared.humanoid.written_rigs import WRITTEN, written_rig

SECTION = "body-certainty"
CHANGES = ("names", "order", "all")
MOST_FRAMES = 600
BY_NAMES = "names"
Body = tuple[SourceRig, SourcePoses]


def people(archives: list[str], most: int) -> Iterator[Body]:
    """Rigs whose names tell the body, each with a motion."""
    for name in WRITTEN:
        written = written_rig(name)
        yield written.rig, written.poses
    clips = Path(__file__).parents[1] / "stages" / "shared" / "clips"
    for archive in (str(clips), *archives):
        found = find_sources([archive], (".bvh", ".amc", ".glb"))
        for source in [found[i] for i in np.unique(np.linspace(0, len(found) - 1, most).astype(int))]:
            body = _body_of(source)
            if body is not None:
                yield body


def _body_of(source: Source) -> Body | None:
    """The rig and motion of a file, by way of a BVH; None, with the reason printed, if it is not read."""
    data = source.read()
    try:
        chosen = recognise(data, source.name)
        if chosen is not None and chosen.name != "bvh":
            recording = read_recordings(data, source, chosen, Asked())[0]
            data = bvh_of_motion(recording.skeleton, recording.motion, source.name)
        bvh = read_bvh(data, source.name)
        return rig_and_poses(bvh.select(np.arange(min(1, bvh.frames - 1), min(bvh.frames, MOST_FRAMES))))
    except InputError as error:
        print(f"left out: {error.message}", file=sys.stderr)
        return None


def creatures(each: int) -> Iterator[tuple[str, Body]]:
    for kind in CREATURES:
        for seed in range(each):
            yield kind, creature(kind, seed)


def way_of(margin: float | None) -> str:
    """How a body was found: by names, or by its shape with a margin of one of the table's steps."""
    if margin is None:
        return BY_NAMES
    return f"{max(least for least, _ in SURE_BY_SHAPE if margin >= least):g}"


def look(rig: SourceRig, poses: SourcePoses) -> tuple[str, np.ndarray, int] | None:
    """How the body was found, its joints' groups and its pelvis; None if it is refused."""
    try:
        body = body_of(rig)
        skeleton, _, _ = motion_of_poses(body, poses)
    except InputError:
        return None
    return way_of(body.parts.margin), skeleton.groups, skeleton.root


def counts(archives: list[str], most: int, each: int) -> tuple[dict[str, Counter[str]], Counter[str], Counter[str]]:
    """By way: how many were right, wrong people and creatures; looks, and refusals, of people and of each kind."""
    ways: dict[str, Counter[str]] = {way: Counter() for way in (BY_NAMES, *(f"{m:g}" for m, _ in SURE_BY_SHAPE))}
    looks: Counter[str] = Counter()
    refused: Counter[str] = Counter()
    for seed, (rig, poses) in enumerate(people(archives, most)):
        named = look(rig, poses)
        if named is None:
            print(f"left out: the names of {', '.join(rig.names[:4])}, ... tell no body", file=sys.stderr)
            continue
        looks["people, named"] += 1
        ways[named[0]]["right"] += 1  # the names are the truth here; sides and groups are held by tests
        for change in CHANGES:
            other, moved, order = changed(rig, poses, change, np.random.default_rng(seed))
            looks["people, nameless"] += 1
            found = look(other, moved)
            if found is None:
                refused["people, nameless"] += 1
                continue
            right = (found[1] == named[1][order]).all() and order[found[2]] == named[2]
            ways[found[0]]["right" if right else "wrong"] += 1
    for seed, (kind, (rig, poses)) in enumerate(creatures(each)):
        for change in ("", *CHANGES):
            other, moved = (
                (rig, poses) if not change else changed(rig, poses, change, np.random.default_rng(seed))[:2]
            )
            found = look(other, moved)
            looks[kind] += 1
            if found is None:
                refused[kind] += 1
            else:
                ways[found[0]]["creatures"] += 1
    return ways, looks, refused


def shares(ways: dict[str, Counter[str]]) -> dict[str, float]:
    """(right + 1) / (taken + 2) of each way; those by shape made to rise with the margin by pooling neighbours."""
    pools = [[[way], ways[way]["right"], ways[way].total()] for way in ways if way != BY_NAMES]
    merged: list[list] = []
    for pool in pools:
        merged.append(pool)
        while len(merged) > 1 and _share(*merged[-2][1:]) > _share(*merged[-1][1:]):
            last = merged.pop()
            merged[-1] = [[*merged[-1][0], *last[0]], merged[-1][1] + last[1], merged[-1][2] + last[2]]
    found = {way: _share(right, taken) for names, right, taken in merged for way in names}
    return {BY_NAMES: _share(ways[BY_NAMES]["right"], ways[BY_NAMES].total()), **found}


def _share(right: int, taken: int) -> float:
    return (right + 1) / (taken + 2)


def tables(archives: list[str], most: int, each: int) -> str:
    """Both tables in Markdown."""
    ways, looks, refused = counts(archives, most, each)
    sure = shares(ways)
    lines = ["| found by | taken | right | wrong parts | creatures | sure |", "|---|---:|---:|---:|---:|---:|"]
    for way, found in ways.items():
        title = "names" if way == BY_NAMES else f"shape, margin from {way}"
        row = [found.total(), found["right"], found["wrong"], found["creatures"]]
        lines.append(f"| {title} | {' | '.join(map(str, row))} | {sure[way]:.2f} |")
    lines += ["", "| looked at | looks | refused |", "|---|---:|---:|"]
    lines += [f"| {what} | {count} | {refused[what]} |" for what, count in looks.items()]
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("archives", nargs="*", help="zip archives or folders of BVH, AMC or GLB")
    parser.add_argument("--most", type=int, default=12, help="clips of each archive")
    parser.add_argument("--creatures", type=int, default=12, help="creatures of each kind")
    parser.add_argument("--page", type=Path, help="page whose section to write")
    arguments = parser.parse_args()
    made = tables(arguments.archives, arguments.most, arguments.creatures)
    print(made)
    if arguments.page:
        replace_section(arguments.page, SECTION, made)
