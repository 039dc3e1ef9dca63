"""Reading DeepMimic clips (the humanoid3d_*.txt of pybullet) and converting them to BVH.

A clip is JSON: {"Loop": "wrap" or "none", "Frames": [[seconds, root x y z, root w x y z, ...], ...]}.
Quaternions are w x y z; knees and elbows are one angle about Z. The body has 13 joints, Y up, faces +X, metres.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from data_schemas.errors import InputError
from data_schemas.notes import Flag, note
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.bvh import BvhFile
from stages.shared.formats.bvh_header_write import header_text
from stages.shared.formats.bvh_motion import motion_of, rate_of, values_of
from stages.shared.formats.bvh_of_motion import template_of
from stages.shared.formats.bvh_write import write_bvh
from stages.shared.formats.recording import Asked, Recording, recording_of
from stages.shared.formats.source_body import SourcePoses, SourceRig
from stages.shared.kinematics.forward import global_rotations
from stages.shared.kinematics.plain_interpolation import interpolate_pose

_WIDTH = 44
_SEAM_SECONDS = 0.4
_STEP_S = (1e-4, 10.0)
_RESAMPLED_FPS = 30.0
_MOST_MADE = 20  # most frames after resampling, per frame of the file
_CM = 100.0
# Name, parent, head in the parent's frame, end site, in metres: the sizes of the humanoid3d model.
_JOINTS: tuple[tuple[str, int, tuple[float, float, float], tuple[float, float, float] | None], ...] = (
    ("root", -1, (0.0, 0.0, 0.0), None),
    ("chest", 0, (0.0, 0.236151, 0.0), None),
    ("neck", 1, (0.0, 0.223894, 0.0), (0.0, 0.2775, 0.0)),
    ("right_shoulder", 1, (-0.02405, 0.2435, 0.18311), None),
    ("right_elbow", 3, (0.0, -0.274788, 0.0), (0.0, -0.258947, 0.0)),
    ("left_shoulder", 1, (-0.02405, 0.2435, -0.18311), None),
    ("left_elbow", 5, (0.0, -0.274788, 0.0), (0.0, -0.258947, 0.0)),
    ("right_hip", 0, (0.0, 0.0, 0.084887), None),
    ("right_knee", 7, (0.0, -0.421546, 0.0), None),
    ("right_ankle", 8, (0.0, -0.40987, 0.0), (0.1335, -0.0225, 0.0)),
    ("left_hip", 0, (0.0, 0.0, -0.084887), None),
    ("left_knee", 10, (0.0, -0.421546, 0.0), None),
    ("left_ankle", 11, (0.0, -0.40987, 0.0), (0.1335, -0.0225, 0.0)),
)
# For each joint the first column of its rotation in a frame, and the number of columns.
_COLUMNS = {
    "root": (4, 4), "chest": (8, 4), "neck": (12, 4),
    "right_hip": (16, 4), "right_knee": (20, 1), "right_ankle": (21, 4),
    "right_shoulder": (25, 4), "right_elbow": (29, 1),
    "left_hip": (30, 4), "left_knee": (34, 1), "left_ankle": (35, 4),
    "left_shoulder": (39, 4), "left_elbow": (43, 1),
}  # fmt: skip


@dataclass(frozen=True)
class DeepMimicClip:
    """times (K,) seconds, roots (K, 3) metres, local (K, 13, 4) xyzw; `loops`: the clip continues at its start."""

    times: np.ndarray
    roots: np.ndarray
    local: np.ndarray
    loops: bool


def read_deepmimic(data: bytes, name: str) -> DeepMimicClip:
    """Parse a clip. Raises InputError if the data are not a clip."""
    # A row has 44 numbers. Text with more brackets or quotes than that is not a clip; its objects would fill memory.
    if data.count(b"[") + data.count(b"{") > len(data) // _WIDTH + 100 or data.count(b'"') > 1000:
        raise InputError(f"{name} is not a DeepMimic clip: it holds more than rows of numbers.")
    try:
        raw = json.loads(data)
        frames = np.array(raw["Frames"], dtype=np.float64)
    except (ValueError, KeyError, TypeError, RecursionError, OverflowError):
        raise InputError(f"{name} is not a DeepMimic clip: it needs JSON with 'Frames' of equal length.") from None
    if frames.ndim != 2 or frames.shape[1] != _WIDTH or len(frames) < 2:
        raise InputError(f"{name}: Frames has the shape {frames.shape}, expected 2 or more of {_WIDTH} numbers.")
    if not np.isfinite(frames).all() or np.abs(frames).max() > 1e6:
        raise InputError(f"{name}: a number is not finite or far too large.")
    if (frames[:-1, 0] < _STEP_S[0]).any() or (frames[:-1, 0] > _STEP_S[1]).any():
        raise InputError(f"{name}: a frame lasts less than {_STEP_S[0]:g} or more than {_STEP_S[1]:g} seconds.")
    local = np.zeros((len(frames), len(_JOINTS), 4))
    for index, (joint, *_) in enumerate(_JOINTS):
        start, width = _COLUMNS[joint]
        if width == 1:
            half = frames[:, start] / 2
            local[:, index, 2], local[:, index, 3] = np.sin(half), np.cos(half)
        else:
            local[:, index] = frames[:, [start + 1, start + 2, start + 3, start]]
    norms = np.linalg.norm(local, axis=-1, keepdims=True)
    if (norms < 0.5).any():
        raise InputError(f"{name}: a quaternion has no length.")
    times = np.concatenate([[0.0], np.cumsum(frames[:-1, 0])])
    return DeepMimicClip(times, frames[:, 1:4], local / norms, raw.get("Loop") == "wrap")


def read_deepmimic_motion(data: bytes, name: str, asked: Asked) -> list[Recording]:
    """The clip of a file, at its own rate if its frames last equally long. Raises InputError naming the file."""
    clip = read_deepmimic(data, name)
    steps = np.diff(clip.times)
    even = np.abs(steps - steps.mean()) < 1e-3 * steps.mean()
    notes, local, roots, fps = [], clip.local, clip.roots, rate_of(float(np.round(steps.mean(), 7)))
    if not even.all():
        fps = _RESAMPLED_FPS
        if clip.times[-1] * fps > _MOST_MADE * len(clip.times):
            raise InputError(
                f"{name}: {len(clip.times)} frames over {clip.times[-1]:.1f} s are too sparse for a motion."
            )
        notes.append(note(Flag.UNEVEN_FRAMES, fps=fps))
        times = torch.arange(int(np.floor(clip.times[-1] * fps + 1e-6)) + 1) / fps
        local, roots = (part.numpy() for part in _between(clip, times))
    joints = range(len(_JOINTS))
    rig = SourceRig(
        names=tuple(joint[0] for joint in _JOINTS),
        parents=tuple(joint[1] for joint in _JOINTS),
        offsets=tuple(joint[2] for joint in _JOINTS),
        end_sites=tuple(joint[3] or (0.0, 0.0, 0.0) for joint in _JOINTS),
        placed=tuple(index == 0 for index in joints),
        unit_m=1.0,
        up_axis="y",
    )
    poses = SourcePoses(local.astype(np.float64), roots.astype(np.float64), asked.fps_override or fps)
    return [recording_of(name, rig, poses, asked, notes=notes)]


def unrolled(clip: DeepMimicClip, least_seconds: float) -> DeepMimicClip:
    """A looping clip repeated until it lasts at least `least_seconds`; each round continues where the last one ended.

    Place on the floor and heading are carried over. The last posture of a loop differs slightly from its first; the
    difference is blended in over the end of each round, so that the motion is continuous.
    """
    rounds = int(np.ceil(least_seconds / clip.times[-1]))
    if not clip.loops or rounds < 2:
        return clip
    turn = _turn_about_y(Rotation.from_quat(clip.local[-1, 0]) * Rotation.from_quat(clip.local[0, 0]).inv())
    ending = _closed(clip, turn)
    times, roots, local = clip.times, clip.roots, ending
    heading = Rotation.identity()
    for i in range(1, rounds):
        heading = turn * heading
        # Frame 0 of a round is the last frame of the round before, so it is left out.
        times = np.concatenate([times, times[-1] + clip.times[1:]])
        placed = heading.apply(clip.roots - clip.roots[0] * _FLOOR) + roots[-1] * _FLOOR
        turned = (ending if i < rounds - 1 else clip.local).copy()
        turned[:, 0] = (heading * Rotation.from_quat(turned[:, 0])).as_quat()
        roots, local = np.concatenate([roots, placed[1:]]), np.concatenate([local, turned[1:]])
    return DeepMimicClip(times, roots, local, clip.loops)


_FLOOR = np.array([1.0, 0.0, 1.0])


def _turn_about_y(rotation: Rotation) -> Rotation:
    """The part of a rotation that turns about the vertical."""
    _, y, _, w = rotation.as_quat()
    return Rotation.from_rotvec([0.0, 2 * np.arctan2(y, w), 0.0])


def _closed(clip: DeepMimicClip, turn: Rotation) -> np.ndarray:
    """Local rotations (K, 13, 4) that end exactly in the first frame's posture, with the root turned by `turn`."""
    goal = clip.local[0].copy()
    goal[0] = (turn * Rotation.from_quat(goal[0])).as_quat()
    rest = (Rotation.from_quat(clip.local[-1]).inv() * Rotation.from_quat(goal)).as_rotvec()
    span = min(_SEAM_SECONDS, clip.times[-1] / 2)
    share = np.clip(1 - (clip.times[-1] - clip.times) / span, 0.0, 1.0)
    share = share * share * (3 - 2 * share)
    out = clip.local.copy()
    for frame in np.flatnonzero(share):
        out[frame] = (Rotation.from_quat(out[frame]) * Rotation.from_rotvec(share[frame] * rest)).as_quat()
    return out


def motion_of_deepmimic(clip: DeepMimicClip, fps: float = 30.0) -> tuple[Skeleton, Motion]:
    """The clip at a constant rate, on the humanoid3d skeleton, by the C1 curve through its frames."""
    times = torch.arange(int(np.floor(clip.times[-1] * fps + 1e-6)) + 1) / fps
    skeleton, _, _ = motion_of(_template())
    local, roots = _between(clip, times)
    return skeleton, Motion(global_rotations(local, skeleton.parents).numpy(), roots.numpy(), fps)


def _between(clip: DeepMimicClip, times: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Local rotations and root positions at the given times, by the C1 curve through the frames."""
    local, roots, _ = interpolate_pose(
        torch.from_numpy(clip.local).float(),
        torch.from_numpy(clip.roots).float(),
        torch.tensor([joint[2] for joint in _JOINTS]),
        torch.from_numpy(clip.times),
        times.double(),
        smooth=1.0,
    )
    return local, roots


def bvh_of_deepmimic(clip: DeepMimicClip, fps: float = 30.0) -> bytes:
    """The clip as a BVH file in centimetres."""
    skeleton, motion = motion_of_deepmimic(clip, fps)
    template = _template(fps)
    return write_bvh(template, values_of(template, skeleton, motion), decimals=4)


@lru_cache(maxsize=4)
def _template(fps: float = 30.0) -> BvhFile:
    """A BVH of the humanoid3d skeleton in centimetres, with one frame of zeros."""
    header = header_text(
        [name for name, *_ in _JOINTS],
        [parent for _, parent, *_ in _JOINTS],
        [[value * _CM for value in offset] for _, _, offset, _ in _JOINTS],
        [[value * _CM for value in end or (0.0, 0.0, 0.0)] for *_, end in _JOINTS],
        [parent < 0 for _, parent, *_ in _JOINTS],
        decimals=4,
    )
    return template_of(header, fps, "humanoid3d")
