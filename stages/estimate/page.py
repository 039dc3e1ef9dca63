"""The overlay page: the keypoints and the result as the estimated camera sees it, played together."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data_schemas.skeleton import Motion, Skeleton
from stages.estimate.config import Config
from stages.shared.formats.keypoint_layouts import landmark_tracks
from stages.shared.formats.keypoints import Keypoints
from stages.shared.humanoid.landmarks import LANDMARKS, landmarks_of
from stages.shared.humanoid.retargeting import Retargeted
from stages.shared.inference.lifting import Lifted, PlacedCamera
from stages.shared.kinematics.cameras import in_camera, projected
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.markup import filled, own_file, script_data

_ASSET = Path(__file__).resolve().parent / "assets" / "overlay.html"
_MOST_FRAMES = 3000
_LINES = (
    ("pelvis", "neck"), ("neck", "head"), ("head", "nose"),
    *(
        (f"{side}_{above}", f"{side}_{below}")
        for side in ("left", "right")
        for above, below in (
            ("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"), ("ankle", "toe"),
        )
    ),
    ("left_shoulder", "right_shoulder"), ("left_hip", "right_hip"),
)  # fmt: skip


def overlay_page(
    config: Config, keypoints: Keypoints, lifted: Lifted, skeleton: Skeleton, made: Motion, turned: Retargeted | None
) -> str:
    """The page's text.

    Args:
        skeleton, made: the result. turned: how it came onto its rig from the lifter's; None if it is on that.
    """
    seen, trust = landmark_tracks(keypoints.names, keypoints.places, keypoints.confidences)
    made_px = projected_result(lifted.camera, skeleton, made, turned)
    every = -(-len(seen) // _MOST_FRAMES)
    there = seen[trust > 0]
    size = keypoints.size or tuple((there.max(axis=0) + there.min(axis=0)).tolist())
    scene = {
        "fps": made.fps / every,
        "size": [float(each) for each in size],
        "lines": [[LANDMARKS.index(one), LANDMARKS.index(other)] for one, other in _LINES],
        "seen": _plain(np.where(trust[..., None] > 0, seen, np.nan)[::every]),
        "made": _plain(made_px[::every]),
        "error_mm": [None if np.isnan(each) else round(1000 * float(each)) for each in lifted.error[::every]],
    }
    title = f"{Path(config.input).name}: keypoints and the motion estimated from them"
    return filled(own_file(_ASSET), title=title, scene=script_data(scene))


def projected_result(camera: PlacedCamera, skeleton: Skeleton, made: Motion, turned: Retargeted | None) -> np.ndarray:
    """(T, L, 2) pixels: the landmarks of the result as the camera sees them, NaN behind it."""
    heads, rotations = positions_of(skeleton, made), made.rotations.astype(np.float64)
    places = landmarks_of(skeleton, heads, rotations).place(heads, rotations)
    # On another rig the world was scaled to its size, and the camera with it.
    position = camera.position if turned is None else turned.in_targets_world(camera.position)
    inside = in_camera(places, position, np.broadcast_to(camera.rotation, (*places.shape[:2], 4)))
    pixels = camera.intrinsics.pixels(projected(inside))
    return np.where(inside[..., 2:] > 0, pixels, np.nan)


def _plain(pixels: np.ndarray) -> list:
    """Rounded numbers; None for points that are not there."""
    return [
        [
            None if np.isnan(x) or abs(x) > 1e6 or abs(y) > 1e6 else [round(float(x), 1), round(float(y), 1)]
            for x, y in frame
        ]
        for frame in pixels
    ]
