"""Measure retargeting between rigs: how near hands and feet come to where the source has them, and how feet slide.

    python benchmarks/retargeting.py [NAME=ARCHIVE!MEMBER.bvh or NAME=FILE.bvh ...] [--page docs/results.md]

Every motion goes to every other rig, with its bones turned alike ("turns"), and then drawn to its places ("solve").
Without arguments two embedded clips stand for two rigs: the second with longer forearms and shorter shins.
Distances are in the target's size, of the ends of forearms and shins, where both rigs have them.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np
from measuring.section import replace_section
from scipy.spatial.transform import Rotation

import stages.shared.clips
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.sources import source_named
from stages.shared.humanoid.bone_matching import LIMBS, bone_lengths, bones_of, match_limb
from stages.shared.humanoid.retargeting import Retargeted, retarget
from stages.shared.inference.retarget_clouds import pull_to_places
from stages.shared.kinematics.foot_contacts import detect_contacts, find_feet, foot_skate_mps
from stages.shared.kinematics.forward import positions_of

SECTION = "retargeting"
MOST_FRAMES = 1200
OF_ARCHIVES = {
    "Bandai Namco": "bandai-namco-1.zip!bandai-namco-1/dataset-1_kick_normal_001.bvh",
    "CMU dance": "cmu-dance.zip!cmu-dance/indian/08.bvh",
    "LaFAN1 G1": "lafan1-g1.zip!lafan1-g1/fight1_subject2.bvh",
}
_HEAD = (
    "| from | to | size | poses apart | hands, turns | solve | feet, turns | solve "
    "| feet slide, source | solve | frames/s |"
)

Body = tuple[Skeleton, Motion]


def bodies_of(named: Sequence[str]) -> dict[str, Body]:
    if not named:
        return _embedded()
    found = {}
    for text in named:
        name, _, place = text.partition("=")
        source = source_named(place)
        skeleton, motion, _ = motion_of(read_bvh(source.read(), source.name), trim_first="auto")
        found[name] = (skeleton, motion.at(slice(MOST_FRAMES)))
    return found


def _embedded() -> dict[str, Body]:
    folder = Path(stages.shared.clips.__file__).parent
    walk, dance = (motion_of(read_bvh((folder / f"{n}.bvh").read_bytes(), n))[:2] for n in ("walk", "dance_a"))
    skeleton = dance[0]
    offsets, tails = skeleton.offsets.copy(), skeleton.tails.copy()
    for group in LIMBS:
        bone, share = bones_of(skeleton, group)[1], 1.25 if group in (1, 2) else 0.85
        tails[bone] *= share
        offsets[skeleton.parents == bone] *= share
    return {"walk": walk, "dance, other limbs": (replace(skeleton, offsets=offsets, tails=tails), dance[1])}


def ends_apart_mm(source: Body, target: Body, turned: Retargeted) -> tuple[float, float]:
    """Mean distance of the forearms' ends and of the shins' from where the source has them, in the target's size."""
    apart = []
    for group in LIMBS:
        pieces = match_limb(source[0], target[0], group)
        second = sorted(pieces, key=lambda piece: -bone_lengths(target[0], piece.target).sum())[:2]
        piece = max(second, key=lambda piece: piece.target)
        wanted = turned.in_targets_world(_tail(source, piece.source[-1]))
        apart.append(1000 * np.linalg.norm(wanted - _tail(target, piece.target[-1]), axis=1).mean())
    return float(np.mean(apart[:2])), float(np.mean(apart[2:]))


def _tail(body: Body, bone: int) -> np.ndarray:
    skeleton, motion = body
    tails = Rotation.from_quat(motion.rotations[:, bone]).apply(skeleton.tails[bone])
    return positions_of(skeleton, motion)[:, bone] + tails


def skate_of(body: Body) -> float:
    skeleton, motion = body
    feet, positions = find_feet(skeleton), positions_of(skeleton, motion)
    return foot_skate_mps(positions, detect_contacts(positions, feet, motion.fps), feet, motion.fps)


def table(bodies: dict[str, Body]) -> str:
    lines = [_HEAD, "|---|---|" + "---:|" * (_HEAD.count("|") - 3)]
    for one, other in permutations(bodies, 2):
        source, (skeleton, poses) = bodies[one], bodies[other]
        began = time.perf_counter()
        turned = retarget(*source, skeleton, poses)
        solved = (skeleton, pull_to_places(*source, skeleton, turned))
        seconds = time.perf_counter() - began
        before = ends_apart_mm(source, (skeleton, turned.motion), turned)
        after = ends_apart_mm(source, solved, turned)
        lines.append(
            f"| {one} | {other} | {turned.size:.2f} | {np.degrees(turned.apart_rad):.0f}° | "
            f"{before[0]:.0f} mm | {after[0]:.0f} mm | {before[1]:.0f} mm | {after[1]:.0f} mm | "
            f"{skate_of(source):.3f} m/s | {skate_of(solved):.3f} m/s | {source[1].frames / seconds:.0f} |"
        )
    return "\n".join(lines)


def of_archives(folder: Path) -> list[str]:
    """A motion of each archive and an embedded one, "NAME=PLACE"; none where an archive is not in the folder."""
    if not all((folder / place.partition("!")[0]).is_file() for place in OF_ARCHIVES.values()):
        return []
    embedded = Path(stages.shared.clips.__file__).parent / "run.bvh"
    return [*(f"{name}={folder / place}" for name, place in OF_ARCHIVES.items()), f"embedded={embedded}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bodies", nargs="*", metavar="NAME=FILE")
    parser.add_argument("--page", type=Path, help="a page whose section is to be replaced")
    parser.add_argument("--archives", type=Path, help="folder of archives that lend a motion each, if they are there")
    options = parser.parse_args()
    lent = of_archives(options.archives) if options.archives else []
    made = table(bodies_of([*options.bodies, *lent]))
    if options.page:
        replace_section(options.page, SECTION, made)
    print(made)


if __name__ == "__main__":
    main()
