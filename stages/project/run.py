"""`pumps project`: a motion in, 2D keypoints as a detector writes them out, with the camera that made them."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from data_schemas.errors import InputError, UsageError
from stages.project.config import Config
from stages.shared.contract import StageReport
from stages.shared.formats.image_size import size_of_text
from stages.shared.formats.keypoint_layouts import landmark_columns, names_of_layout
from stages.shared.formats.readers import recordings_in
from stages.shared.formats.recording import Asked
from stages.shared.formats.sources import source_named
from stages.shared.humanoid.detector_errors import PRESETS, with_errors
from stages.shared.humanoid.landmarks import landmarks_of
from stages.shared.kinematics.cameras import (
    camera_as_data,
    in_camera,
    intrinsics_of_fov,
    look_at,
    placed_around,
    projected,
    random_place,
)
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.outputs import check_file, write_output
from stages.shared.progress import SILENT, Progress

_DECIMALS = 3  # of a pixel


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Write the keypoints.

    Raises: InputError for an input that is not one motion of a humanoid, UsageError for a layout that there is not.
    """
    check_file(config, (".json",))
    size = size_of_text(config.image_size)
    names = names_of_layout(config.layout)
    columns, chosen = landmark_columns(config.layout)
    progress.start("projecting", 2)
    found = recordings_in(source_named(str(config.input)), Asked())
    if len(found) != 1:
        raise InputError(f"{config.input} holds {len(found)} clips, and one is projected.", "`pumps export` one.")
    skeleton, motion = found[0].skeleton, found[0].motion
    heads = positions_of(skeleton, motion)
    rotations = motion.rotations.astype(np.float64)
    landmarks = landmarks_of(skeleton, heads, rotations).place(heads, rotations)
    progress.advance(note="read")
    rng = np.random.default_rng(config.seed)
    middle = landmarks[:, 0].mean(axis=0)
    height = float(np.median(np.ptp(landmarks[..., 1], axis=1)))
    position = random_place(rng, middle, height)
    position = placed_around(position, middle, config.azimuth, config.elevation, config.distance)
    rotation = look_at(position, middle)
    intrinsics = intrinsics_of_fov(config.fov, size)
    seen = in_camera(landmarks, position, np.broadcast_to(rotation, (*landmarks.shape[:2], 4)))
    if (seen[..., 2] <= 0).any():
        raise UsageError("The body passes behind the camera.", "Give a larger --distance.")
    places, trust = with_errors(intrinsics.pixels(projected(seen)), rng, PRESETS[config.errors])
    keypoints = np.full((len(places), len(names), 3), np.nan)
    keypoints[..., 2] = 0.0
    keypoints[:, columns, :2], keypoints[:, columns, 2] = places[:, chosen], trust[:, chosen]
    camera = camera_as_data(position, rotation, intrinsics)
    data = json_of_keypoints(keypoints, names, size, motion.fps, {"layout": config.layout, "camera": camera})
    write_output(config.output, data)
    progress.advance(note="written")
    inside = np.all((places > 0) & (places < np.array(size)), axis=-1)
    lines = [f"{len(places)} frames of {len(names)} keypoints ({config.layout}) in {config.output}."]
    if (share := float(inside[trust > 0].mean())) < 0.98:
        lines.append(f"Note: {1 - share:.0%} of the points lie outside the image; give a larger --distance or --fov.")
    return StageReport(output=config.output, lines=lines, figures={"frames": len(places), "camera": camera})


def json_of_keypoints(
    keypoints: np.ndarray, names: tuple[str, ...], size: tuple[float, float], fps: float, more: dict[str, Any]
) -> bytes:
    """MMPose's JSON of one person: keypoints (T, K, 3) of x, y in pixels and confidence; a missing point is 0, 0 with
    score 0."""
    frames = []
    for number, rows in enumerate(keypoints):
        there = rows[:, 2] > 0
        instance = {
            "keypoints": np.where(there[:, None], rows[:, :2], 0.0).round(_DECIMALS).tolist(),
            "keypoint_scores": np.where(there, rows[:, 2], 0.0).round(_DECIMALS).tolist(),
        }
        frames.append({"frame_id": number, "instances": [instance] if there.any() else []})
    meta = {
        "keypoint_id2name": {str(at): name for at, name in enumerate(names)},
        "image_size": list(size),
        "fps": fps,
        **more,
    }
    return (json.dumps({"meta_info": meta, "instance_info": frames}, allow_nan=False) + "\n").encode()
