"""Clouds to the motion of one rig, by the network that was trained for it (PC-MRL 3.2)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError
from data_schemas.manifest import open_artefact
from data_schemas.skeleton import Motion
from data_schemas.trainings import last_sentence
from stages.shared.inference.bounded_network import MOST_POINTS, MOST_WINDOW, build_bounded, whole_setting
from stages.shared.inference.models import Span, batches_of, load_state, overlapping_windows, rows_of
from stages.shared.kinematics.conventions import GROUPS, MODEL_FPS
from stages.shared.kinematics.rotations import aligned_signs, unit
from stages.shared.networks.layers.device import choose_device
from stages.shared.networks.layers.sizes import EncoderSizes, SkeletonSizes
from stages.shared.networks.pcmrl.skeleton_network import Seen, SkeletonNetwork
from stages.shared.pointcloud.rig import Rig, pose_heads
from stages.shared.solve.binding import bind_points
from stages.shared.solve.skeleton_pose import pose_of_motion, replace_rows
from stages.shared.solve.solving import SolveOptions, solve_pose

# The network's pose is right to a few centimetres, and the points have no error of their own.
FROM_NETWORK = SolveOptions(point_noise_m=0.03, turn_prior_rad=0.3, shift_prior_m=0.1)
_FRAMES_AT_ONCE = 512  # clouds encoded in one call


@dataclass(frozen=True)
class RigNetwork:
    """A network in use, and the rig that it moves.

    window: frames of a training window, and of a window in use. points: of a cloud in training; any number can be
    given.
    """

    network: SkeletonNetwork
    rig: Rig
    window: int
    points: int
    licences: tuple[str, ...]
    trained_on: str
    digest: str
    device: torch.device

    def pose(self, points: Tensor, groups: Tensor, fps: float = MODEL_FPS) -> tuple[Tensor, Tensor]:
        """The pose of the rig's body in every frame of a clip of any length, by windows that are blended.

        Args:
            points: (T, P, 3) metres. groups: (P,) body groups.
            fps: frame rate of the clip; the network was trained at 30.

        Returns: pelvis (T, 3) metres and global rotations (T, B, 4) of the body's bones, on the CPU.
        """
        frames, bones = len(points), len(self.rig.body.joints)
        pelvis, turns, weights = torch.zeros(frames, 3), torch.zeros(frames, bones, 4), torch.zeros(frames)
        times = torch.arange(self.window, device=self.device).unsqueeze(0) * (MODEL_FPS / fps)
        with torch.inference_mode():
            seen = self._see(points, groups.long())
            plan = overlapping_windows(frames, self.window)
            for some in batches_of([Span(start, stop, start, stop, fade) for start, stop, fade in plan]):
                part = Seen(*(rows_of(each, some) for each in seen))
                length = part.yaw.shape[1]  # all windows of a clip are equally long
                pose = self.network.pose(part, times[:, :length])
                for row, (_, _, start, stop, fade) in enumerate(some):
                    turned = aligned_signs(pose.rotations[row].cpu(), turns[start:stop])
                    pelvis[start:stop] += fade[:, None] * pose.heads[row, :, 0].cpu()
                    turns[start:stop] += fade[:, None, None] * turned
                    weights[start:stop] += fade
        return pelvis / weights[:, None], unit(turns)

    def _see(self, points: Tensor, groups: Tensor) -> Seen:
        """Encode every frame once: features (T, W), centroids (T, 3), yaw (T,), on the device."""
        yaw = self.network.headings(points.unsqueeze(0).float(), groups.unsqueeze(0))[0]
        groups = groups.to(self.device).unsqueeze(0)
        parts = []
        for chunk, turn in zip(points.split(_FRAMES_AT_ONCE), yaw.split(_FRAMES_AT_ONCE), strict=True):
            chunk = chunk.to(self.device, torch.float32).unsqueeze(0)
            parts.append(self.network.see(chunk, groups, turn.to(self.device).unsqueeze(0)))
        return Seen(*(torch.cat([part[0] for part in column]) for column in zip(*parts, strict=True)))


def decode_cloud(
    network: RigNetwork, points: Tensor | np.ndarray, groups: Tensor | np.ndarray, fps: float = 30.0
) -> Motion:
    """The rig's motion that is most similar to a cloud.

    Args:
        points: (T, P, 3) metres, Y up; positions of points on any skeleton, or on none.
        groups: (P,) body groups 0 to 4.
        fps: frames a second.

    Returns: T frames of `network.rig.skeleton`; joints without points stay at rest.
    Raises: InputError if the cloud is empty, is not finite, or has no groups.
    """
    points = torch.as_tensor(points, dtype=torch.float32)
    groups = torch.as_tensor(np.asarray(groups)).long()
    if points.dim() != 3 or points.shape[2] != 3 or min(points.shape) == 0 or groups.shape != points.shape[1:2]:
        raise InputError(
            f"A cloud of shape {tuple(points.shape)} with {len(groups)} body groups is none.",
            "Give points (frames, points, 3) and a group for each point.",
        )
    if not bool(torch.isfinite(points).all()) or not bool(((groups >= 0) & (groups < GROUPS)).all()):
        raise InputError("The cloud has a position that is not finite, or a body group that is none.", "Mend it.")
    return network.rig.motion(*network.pose(points, groups, fps), fps)


def solve_from_network(
    network: RigNetwork, points: Tensor | np.ndarray, groups: Tensor | np.ndarray, fps: float = 30.0
) -> Motion:
    """The network's motion, then the solve, which makes the points of a bone stand still in the bone's frame.

    As `decode_cloud`, but without its errors that vary from frame to frame. The positions of the points on the bones
    come from the network, so errors that are the same in every frame remain.
    """
    skeleton = network.rig.skeleton
    motion = decode_cloud(network, points, groups, fps)
    cloud = torch.as_tensor(points, dtype=torch.float32)
    pose = pose_of_motion(skeleton, motion)
    binding = bind_points(cloud, torch.as_tensor(np.asarray(groups)), skeleton, *pose.world())
    solved = solve_pose(cloud, binding, *pose.parts, skeleton.parents, skeleton.root, FROM_NETWORK)
    corrected = pose.corrected(solved.turns, solved.shifts)
    return replace_rows(skeleton, motion, corrected, np.arange(motion.frames))


def body_heads(rig: Rig, pelvis: Tensor, rotations: Tensor) -> Tensor:
    """Heads (T, B, 3) of the body's bones in a pose, metres."""
    return pose_heads(rig.body, pelvis, rotations)


def load_rig_network(path: str | Path, device: str = "auto") -> RigNetwork:
    """The network of a checkpoint that `pumps train skeleton` wrote. Raises InputError if the checkpoint is of
    another kind."""
    artefact = open_artefact(path, "checkpoint")
    kept = read_checkpoint(artefact, optimiser=False)
    if kept.config.get("network") != "skeleton":
        raise InputError(f"{path} holds no network of a rig.", "Give the folder that `pumps train skeleton` wrote.")
    rig = Rig.of_plain(kept.config.get("rig"))
    chosen = choose_device(device)
    network = build_bounded(
        lambda: SkeletonNetwork(
            rig.body, EncoderSizes(**kept.config["encoder"]), SkeletonSizes(**kept.config["skeleton"])
        ),
        kept.config.get("skeleton"),
        kept.weights,
        path,
    )
    load_state(network, kept.weights, path)
    return RigNetwork(
        network.to(chosen).eval(),
        rig,
        whole_setting(kept.config, "window", MOST_WINDOW, path),
        whole_setting(kept.config, "points", MOST_POINTS, path),
        tuple(artefact.manifest.licences),
        last_sentence(kept.trainings),
        artefact.manifest.digest,
        chosen,
    )
