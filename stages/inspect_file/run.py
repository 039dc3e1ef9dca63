"""`pumps inspect`: what a BVH holds and what pumps makes of it, before anything is done with it."""

from __future__ import annotations

from typing import Any

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import BODY_GROUPS, Motion, Skeleton
from stages.config import StageReport
from stages.formats.bvh import BvhFile, BvhJoint, read_bvh
from stages.formats.bvh_motion import motion_of, places_of
from stages.formats.sources import Source, find_sources
from stages.inspect_file.config import Config
from stages.progress import SILENT, Progress

_SHORT = {"Xposition": "x", "Yposition": "y", "Zposition": "z", "Xrotation": "X", "Yrotation": "Y", "Zrotation": "Z"}
_JUMP_M_S = 30.0  # nothing on a body moves that fast


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Describe one file in full, or every file of an archive or folder in a line each.

    Raises: InputError where there is nothing to read, or the one file is no BVH.
    """
    sources = find_sources([config.path])
    if len(sources) == 1:
        return _describe(sources[0], config.rest_frame)
    lines: list[str] = []
    problems = 0
    progress.start("Inspecting", total=len(sources))
    for source in sources:
        try:
            figures = _describe(source, config.rest_frame).figures
            found = figures["problems"]
            told = f"{figures['joints']} joints, {figures['frames']} frames at {figures['fps']:g} fps"
        except InputError as error:
            found, told = [error.message], "unreadable"
        problems += bool(found)
        lines.append(f"{source.member}: {told}" + (f"; {' '.join(found)}" if found else ""))
        progress.advance(1, source.member)
    lines.append(f"{len(sources)} files, {problems} with something to know.")
    return StageReport(lines=lines, figures={"files": len(sources), "with_problems": problems})


def _describe(source: Source, rest_frame: int | None) -> StageReport:
    bvh = read_bvh(source.read(), source.name)
    problems = list(bvh.warnings)
    skeleton: Skeleton | None = None
    motion: Motion | None = None
    try:
        skeleton, motion, notes = motion_of(bvh, rest_frame=rest_frame, trim_first="auto")
        problems += [note for note in notes if note not in problems]
    except InputError as error:
        problems.append(error.message)
    fps = motion.fps if motion else 1.0 / bvh.frame_time
    channels = sum(len(joint.channels) for joint in bvh.joints)
    lines = [
        source.name,
        f"  {len(bvh.joints)} joints, {channels} channels; {bvh.frames} frames at {fps:g} fps,"
        f" {bvh.frames / fps:.2f} seconds",
    ]
    figures: dict[str, Any] = {"joints": len(bvh.joints), "channels": channels, "frames": bvh.frames, "fps": fps}
    if skeleton is not None and motion is not None:
        facts, more = _figure_facts(skeleton, motion)
        lines += [f"  {fact}" for fact in facts]
        problems += _motion_problems(skeleton, motion)
        figures |= more
    lines += ["", *_tree(bvh, skeleton), ""]
    lines += [f"problem: {problem}" for problem in problems] or ["No problems found."]
    return StageReport(lines=lines, figures=figures | {"problems": problems})


def _figure_facts(skeleton: Skeleton, motion: Motion) -> tuple[list[str], dict[str, Any]]:
    seen = places_of(skeleton, motion)[:, skeleton.sampled]
    height = float(np.percentile(seen[..., 1].max(axis=1) - seen[..., 1].min(axis=1), 90))
    tracks = [skeleton.names[joint] for joint in motion.track_joints]
    groups = {
        name: int(((skeleton.groups == index) & skeleton.sampled).sum()) for index, name in enumerate(BODY_GROUPS)
    }
    facts = [
        f"unit {skeleton.unit_m:g} m, {skeleton.up_axis.upper()} up; the joints span {height:.2f} m upright",
        f"pelvis: {skeleton.names[skeleton.root]}; positions vary on: {', '.join([skeleton.names[0], *tracks])}",
        "bones that carry points: " + ", ".join(f"{count} {name}" for name, count in groups.items()),
    ]
    return facts, {
        "unit_m": skeleton.unit_m,
        "up_axis": skeleton.up_axis,
        "pelvis": skeleton.names[skeleton.root],
        "height_m": round(height, 3),
        "tracks": tracks,
        "bones": groups,
    }


def _motion_problems(skeleton: Skeleton, motion: Motion) -> list[str]:
    problems = []
    if motion.frames < 2:
        return ["There is only one frame: a pose, no motion."]
    speeds = np.linalg.norm(np.diff(places_of(skeleton, motion)[:, skeleton.sampled], axis=0), axis=-1) * motion.fps
    fastest = speeds.max(axis=1)
    jumps = np.flatnonzero(fastest > _JUMP_M_S)
    if len(jumps):
        where = ", ".join(str(frame + 1) for frame in jumps[:5]) + (", ..." if len(jumps) > 5 else "")
        problems.append(
            f"Some joint moves faster than {_JUMP_M_S:g} m/s into frame {where}: a jump, or a wrong frame time."
        )
    if fastest.max() < 1e-3:
        problems.append("Nothing moves.")
    return problems


def _tree(bvh: BvhFile, skeleton: Skeleton | None) -> list[str]:
    depth: list[int] = []
    lines = []
    for index, joint in enumerate(bvh.joints):
        depth.append(0 if joint.parent < 0 else depth[joint.parent] + 1)
        name = "  " * (depth[-1] + 1) + joint.name
        lines.append(f"{name:<36}{_channels(joint):<10}{_role(skeleton, index)}".rstrip())
    return lines


def _channels(joint: BvhJoint) -> str:
    return "".join(_SHORT[channel] for channel in joint.channels) or "-"


def _role(skeleton: Skeleton | None, joint: int) -> str:
    if skeleton is None:
        return ""
    if skeleton.groups[joint] < 0:
        return "(outside the body)"
    group = BODY_GROUPS[skeleton.groups[joint]]
    length = float(np.linalg.norm(skeleton.tails[joint]))
    pelvis = ", pelvis" if joint == skeleton.root else ""
    if not skeleton.sampled[joint]:
        return f"{group}{pelvis}, not seen by points"
    return f"{group}{pelvis}, {length * 100:.1f} cm"
