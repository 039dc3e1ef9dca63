"""`pumps retarget`: a motion on another rig, named as it likes, built as it likes."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from data_schemas.errors import InputError
from data_schemas.motion import skeleton_id
from data_schemas.notes import sentences_of
from data_schemas.skeleton import Motion, Skeleton
from stages.retarget.config import Config
from stages.retarget.targets import Target, read_target
from stages.shared.contract import StageReport
from stages.shared.formats.readers import recordings_in
from stages.shared.formats.recording import Asked
from stages.shared.formats.rig_option import rig_named
from stages.shared.formats.sources import source_named
from stages.shared.formats.writers import SUFFIXES, bytes_of_motion, written_format
from stages.shared.humanoid.retargeting import REST_POSE, Retargeted, retarget
from stages.shared.inference.clouds import place_on_pose
from stages.shared.inference.retarget_clouds import SIGMA_M, pull_to_places
from stages.shared.inference.skeleton_decoding import decode_cloud, load_rig_network, solve_from_network
from stages.shared.kinematics.foot_contacts import detect_contacts, find_feet, foot_skate_mps
from stages.shared.kinematics.forward import positions_of
from stages.shared.many_files.file_runs import over_files
from stages.shared.networks.layers.device import choose_device
from stages.shared.outputs import check_file, write_output
from stages.shared.pointcloud.drawn_points import draw_on_skeleton
from stages.shared.progress import SILENT, Progress
from stages.shared.solve.skeleton_pose import pose_of_motion

STRANGE_RAD = np.radians(45)  # reference poses further apart than this, on average, are worth a warning


@over_files
def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Retarget a recording.

    Raises: UsageError for an output that exists or has a suffix that cannot be written; InputError for files that
    are not humanoids, and for a rig with neither a rest pose nor a frame of motion.
    """
    started = time.perf_counter()
    check_file(config, SUFFIXES.values())
    progress.start("retargeting", 3)
    source, motion, notes = _read(config)
    target = read_target(config)
    progress.advance(note="read")
    made, turned = retargeted(source, motion, target.skeleton, target.poses, config)
    progress.advance(note="moved")
    data, losses = _in_format_of(config.output, target, made)
    write_output(config.output, data)
    progress.advance(note="written")
    notes = [*(f"{config.input}: {note}" for note in notes), *(f"{config.to}: {note}" for note in target.notes)]
    notes += losses
    return _report(config, source, motion, target.skeleton, made, turned, notes, time.perf_counter() - started)


def retargeted(
    source: Skeleton, motion: Motion, target: Skeleton, poses: Motion, config: Config
) -> tuple[Motion, Retargeted]:
    """A motion on another rig.

    Args:
        poses: a motion of the target, whose frames are poses that it may start from.
        config: the method and its settings; its files are not looked at.

    Returns: the target's motion, and how it was found.
    Raises: InputError for a rig without a pose to start from, or a network of another rig.
    """
    turned = retarget(source, motion, target, poses)
    return _moved(config, source, motion, target, turned), turned


def _in_format_of(output: Path, target: Target, made: Motion) -> tuple[bytes, list[str]]:
    """The motion in the rig's own format, or as `pumps export` writes it if the output has another suffix."""
    if output.suffix.lower() == target.suffix:
        return target.written(made)
    return bytes_of_motion(written_format(output), target.skeleton, made, output.stem)


def _moved(config: Config, source: Skeleton, motion: Motion, target: Skeleton, turned: Retargeted) -> Motion:
    """The target's motion by the method asked for."""
    if config.method == "turns":
        return turned.motion
    if config.method == "solve":
        device = choose_device(config.device)
        return pull_to_places(source, motion, target, turned, points=config.points, seed=config.seed, device=device)
    network = load_rig_network(str(config.network), config.device)
    if skeleton_id(network.rig.skeleton) != skeleton_id(target):
        raise InputError(
            f"{config.network} was trained for another rig than {config.to}.",
            f"Train one for it: pumps train skeleton --skeleton {config.to}.",
        )
    drawn = draw_on_skeleton(source, config.points, np.random.default_rng(config.seed), SIGMA_M)
    cloud = place_on_pose(drawn, pose_of_motion(source, motion), source)
    in_size = turned.in_targets_world(cloud.numpy())
    decode = solve_from_network if config.method == "both" else decode_cloud
    return decode(network, in_size.astype(np.float32), drawn.groups, motion.fps)


def _read(config: Config) -> tuple[Skeleton, Motion, list[str]]:
    """The motion of the input, with notes on it. Raises InputError where it holds none, or several."""
    source = source_named(str(config.input))
    rig, rig_name = rig_named(config.skeleton) if config.skeleton is not None else (b"", "")
    asked = Asked(fps_override=config.fps_override, rig=rig, rig_name=rig_name, up_axis=config.up_axis)
    found = recordings_in(source, asked)
    if len(found) != 1:
        raise InputError(f"{source.name} holds {len(found)} clips, and one is put on a rig.", "`pumps export` one.")
    return found[0].skeleton, found[0].motion, sentences_of([*found[0].notes, *found[0].remarks])


def _report(
    config: Config,
    source: Skeleton,
    motion: Motion,
    target: Skeleton,
    made: Motion,
    turned: Retargeted,
    notes: list[str],
    seconds: float,
) -> StageReport:
    skates = [_skate(source, motion), _skate(target, made)]
    apart = float(np.degrees(turned.apart_rad))
    alike = [_pose_name(turned.source_frame, "the motion"), _pose_name(turned.target_frame, "the rig's file")]
    lines = [f"Note: {note}" for note in notes]
    if turned.apart_rad > STRANGE_RAD:
        lines.append(
            f"Note: no pose of the two rigs is alike (limbs {apart:.0f} degrees apart); give a BVH of the rig with a "
            "frame that the motion comes close to."
        )
    gist = [
        *lines,
        f"{made.frames} frames on {target.joints} joints in {seconds:.2f} s; the rig's legs are {turned.size:.2f} "
        "times as long, and so are its paths.",
    ]
    lines = [
        *gist,
        f"Taken for the same pose: {' and '.join(alike)}; their limbs are {apart:.0f} degrees apart.",
        f"Feet that stand slide at {skates[0]:.3f} m/s in the source and {skates[1]:.3f} m/s in the result.",
    ]
    figures = {
        "frames": made.frames,
        "seconds": seconds,
        "size": turned.size,
        "source_frame": turned.source_frame,
        "target_frame": turned.target_frame,
        "apart_degrees": apart,
        "foot_skate_mps": {"source": skates[0], "result": skates[1]},
    }
    return StageReport(output=config.output, lines=lines, gist=gist, figures=figures)


def _pose_name(frame: int, whose: str) -> str:
    return f"the rest pose of {whose}" if frame == REST_POSE else f"frame {frame} of {whose}"


def _skate(skeleton: Skeleton, motion: Motion) -> float:
    feet, positions = find_feet(skeleton), positions_of(skeleton, motion)
    return foot_skate_mps(positions, detect_contacts(positions, feet, motion.fps), feet, motion.fps)
