"""`pumps estimate`: one person's keypoints in, motion on a rig out."""

from __future__ import annotations

import time

import numpy as np

from data_schemas.errors import InputError, UsageError
from data_schemas.motion import skeleton_id
from data_schemas.notes import sentences_of
from data_schemas.skeleton import Motion, Skeleton
from stages.estimate.config import Config
from stages.estimate.page import overlay_page
from stages.estimate.rig import Target, target_of
from stages.shared.contract import StageReport
from stages.shared.formats.image_size import intrinsics_of_text, size_of_text
from stages.shared.formats.keypoint_files import holds_keypoints, read_keypoints
from stages.shared.formats.keypoint_world import places_in
from stages.shared.formats.keypoints import Keypoints
from stages.shared.formats.writers import SUFFIXES
from stages.shared.humanoid.retargeting import Retargeted, retarget
from stages.shared.inference.lifting import Lifted, assumed_intrinsics, lift
from stages.shared.inference.pose_model import PoseModel, load_pose_model
from stages.shared.inference.retarget_clouds import pull_to_places
from stages.shared.kinematics.cameras import Intrinsics, camera_as_data, intrinsics_of_fov
from stages.shared.networks.layers.device import choose_device
from stages.shared.outputs import check_file, write_output
from stages.shared.progress import SILENT, Progress
from stages.shared.weights.task_weights import task_weights

_USUAL_FPS = 30.0
_FEW = 0.5  # share of frames without the person from which the note says that they are most of the clip


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Estimate the motion, put it on the rig and write it.

    Raises: UsageError for options that contradict each other or an output that exists; InputError for keypoints of no
        known layout, no frame with enough points, a missing image size, or a rig that is not a humanoid.
    """
    started = time.perf_counter()
    check_file(config, SUFFIXES.values())
    if config.page is not None:
        check_file(config, (".html", ".htm"), "page")
    progress.start("estimating", 3)
    if holds_keypoints(str(config.input)):
        return _of_keypoints(config, progress, started)
    return _of_places(config, progress, started)


def _of_keypoints(config: Config, progress: Progress, started: float) -> StageReport:
    size = size_of_text(config.image_size) if config.image_size is not None else None
    keypoints = read_keypoints(str(config.input), person=config.person, layout=config.layout, size=size)
    intrinsics, known, notes = _camera(config, keypoints)
    fps = config.fps or keypoints.fps or _USUAL_FPS
    if config.fps is None and keypoints.fps is None:
        notes.append(f"{config.input} states no frame rate: {_USUAL_FPS:g} is assumed; give --fps.")
    model = load_pose_model(task_weights(config.weights), "estimate", config.device)
    target = target_of(config.skeleton, model.rig)
    progress.advance(note="read")
    lifted = lift(model, keypoints, intrinsics, known=known, fps=fps)
    progress.advance(note="lifted")
    made, turned = _on_rig(config, model.rig.skeleton, lifted.motion, target)
    data, losses = target.written(made, config.output)
    page = overlay_page(config, keypoints, lifted, target.skeleton, made, turned) if config.page else ""
    write_output(config.output, data)
    if config.page is not None:
        write_output(config.page, page.encode("utf-8"))
    progress.advance(note="written")
    notes += [*_remarks(keypoints), *target.notes, *losses]
    return _report(config, keypoints, lifted, made, model, notes, time.perf_counter() - started)


def _camera(config: Config, keypoints: Keypoints) -> tuple[Intrinsics, bool, list[str]]:
    """The camera, whether its focal length is known, and notes. Raises InputError where an image size is missing."""
    if config.intrinsics is not None:
        focal, *centre = intrinsics_of_text(config.intrinsics)
        return Intrinsics(focal, (centre[0], centre[1])), True, []
    if config.fov is not None:
        if keypoints.size is None:
            raise InputError(
                f"{config.input} does not state the image's size, which --fov refers to.",
                "Give --image-size 1920x1080.",
            )
        return intrinsics_of_fov(config.fov, keypoints.size), True, []
    notes = []
    if keypoints.size is None:
        notes.append(
            f"{config.input} does not state the image's size: the middle of the keypoints is assumed to be the "
            "image's; give --image-size."
        )
    return assumed_intrinsics(keypoints, keypoints.size), False, notes


def _of_places(config: Config, progress: Progress, started: float) -> StageReport:
    """Landmarks in 3D: read as motion by inverse kinematics, then put on the rig."""
    given = {"page": config.page, "fov": config.fov, "intrinsics": config.intrinsics, "image-size": config.image_size}
    for name, value in given.items():
        if value is not None:
            raise UsageError(f"--{name} is for 2D keypoints, and {config.input} holds places in 3D.", "Leave it out.")
    found = places_in(str(config.input), config.layout, config.fps)
    model = (
        load_pose_model(task_weights(config.weights), "estimate", config.device) if config.skeleton is None else None
    )
    target = target_of(config.skeleton, model.rig if model is not None else None)
    progress.advance(2, note="read")
    made, _ = _on_rig(config, found.skeleton, found.motion, target)
    data, losses = target.written(made, config.output)
    write_output(config.output, data)
    progress.advance(note="written")
    seconds = time.perf_counter() - started
    notes = [*sentences_of([*found.notes, *found.remarks]), *target.notes, *losses]
    return StageReport(
        output=config.output,
        lines=[f"{made.frames} frames of places in 3D on {target.skeleton.joints} joints in {seconds:.2f} s."]
        + [f"Note: {note}" for note in notes],
        figures={"frames": made.frames, "seconds": seconds, "notes": notes},
    )


def _on_rig(config: Config, source: Skeleton, motion: Motion, target: Target) -> tuple[Motion, Retargeted | None]:
    """The motion on the rig; unchanged if it is on that rig already."""
    if skeleton_id(source) == skeleton_id(target.skeleton):
        return motion, None
    turned = retarget(source, motion, target.skeleton, target.poses)
    if config.method == "turns":
        return turned.motion, turned
    device = choose_device(config.device)
    return pull_to_places(source, motion, target.skeleton, turned, seed=config.seed, device=device), turned


def _remarks(keypoints: Keypoints) -> list[str]:
    notes = []
    if keypoints.missing:
        share = keypoints.missing / len(keypoints.places)
        more = " The motion there is a guess." if share < _FEW else " That is most of the clip: expect little of it."
        notes.append(f"{keypoints.missing} frames hold too few points of this person.{more}")
    return notes


def _report(
    config: Config,
    keypoints: Keypoints,
    lifted: Lifted,
    made: Motion,
    model: PoseModel,
    notes: list[str],
    seconds: float,
) -> StageReport:
    view, intrinsics = lifted.view, lifted.camera.intrinsics
    error = float(np.nanmean(lifted.error))
    width = (keypoints.size or (2 * intrinsics.centre[0], 0))[0]
    fov = float(np.degrees(2 * np.arctan(width / 2 / intrinsics.focal_px)))
    who = f"person {config.person} of {keypoints.people}" if keypoints.people > 1 else "one person"
    lines = [
        f"{made.frames} frames of {who} ({keypoints.layout}) in {seconds:.2f} s.",
        f"Camera: {lifted.camera.position[1]:.2f} m above the floor, looking {np.degrees(view.pitch):.0f} degrees "
        f"down, field of view {fov:.0f} degrees.",
        f"The result projected lies {1000 * error:.0f} mm (root mean square) from the keypoints.",
        *[f"Note: {note}" for note in notes],
        *[f"Licence of the weights: {licence}" for licence in model.licences],
    ]
    figures = {
        "frames": made.frames,
        "seconds": seconds,
        "layout": keypoints.layout,
        "people": keypoints.people,
        "frames_without_person": keypoints.missing,
        "reprojection_mm": 1000 * error,
        "camera": camera_as_data(lifted.camera.position, lifted.camera.rotation, intrinsics),
        "notes": notes,
        "licences": list(model.licences),
    }
    return StageReport(output=config.output, lines=lines, figures=figures)
