"""A network for a task in one rig's pose space, in use: loaded from its checkpoint, run over clips of any length."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError
from data_schemas.manifest import open_artefact
from data_schemas.trainings import last_sentence
from stages.shared.inference.bounded_network import MOST_WINDOW, build_bounded, whole_setting
from stages.shared.inference.models import load_state, overlapping_windows
from stages.shared.kinematics.rotations import aligned_signs, unit
from stages.shared.networks.layers.device import choose_device
from stages.shared.pointcloud.rig import Rig
from stages.shared.pose_tasks.body_pose import BodyPose, outputs_of
from stages.shared.pose_tasks.pose_network import NETWORKS, PoseNetwork
from stages.shared.pose_tasks.registry import task_named, task_names
from stages.shared.pose_tasks.task import PoseTask


@dataclass(frozen=True)
class PoseModel:
    """A trained network, and the task and the rig that it is for.

    window: frames of a training window, and of a window in use. minutes, steps: of its last training; 0 if not known.
    """

    network: PoseNetwork
    task: PoseTask
    window: int
    licences: tuple[str, ...]
    trained_on: str
    digest: str
    device: torch.device
    minutes: float = 0.0
    steps: int = 0

    @property
    def rig(self) -> Rig:
        return self.task.rig

    def pose(self, features: Tensor, given: Tensor, base: BodyPose, times: Tensor) -> BodyPose:
        """The network's poses of windows, on the CPU; arguments as `TaskBatch` has them, times (B or 1, T)."""
        with torch.inference_mode():
            made = self.network(
                features.to(self.device), given.to(self.device), base.to(self.device), times.to(self.device)
            )
        return made.to(torch.device("cpu"))


def load_pose_model(path: str | Path, tasks: str | tuple[str, ...] | None, device: str = "auto") -> PoseModel:
    """The network of a checkpoint that `pumps train finetune` wrote for a task, one of several, or any (None).

    Raises: InputError if the checkpoint is of another kind, for another task, or for one of a package that is not
        installed.
    """
    artefact = open_artefact(path, "checkpoint")
    kept = read_checkpoint(artefact, optimiser=False)
    config = kept.config
    tasks = (tasks,) if isinstance(tasks, str) else tasks
    wanted = f" --task {tasks[0]}" if tasks else ""
    mend = f"Give the folder that `pumps train finetune{wanted}` wrote."
    if config.get("network") != "pose" or config.get("kind") not in NETWORKS:
        raise InputError(f"{path} holds no network that was fine-tuned for a task.", mend)
    task = config.get("task")
    if tasks is not None and task not in tasks:
        raise InputError(f"{path} holds a network for the task {task!r}, not {tasks[0]}.", mend)
    if not isinstance(task, str) or task not in task_names():
        raise InputError(
            f"{path} holds a network for the task {task!r}, and there is no such task here.",
            "Install the package that the task comes from.",
        )
    made = task_named(task, Rig.of_plain(config.get("rig")), str(config.get("corruption")))
    outputs = outputs_of(made.rig.body)
    network = build_bounded(
        lambda: PoseNetwork(config["kind"], made.features, outputs, config["settings"]),
        config.get("settings"),
        kept.weights,
        path,
    )
    load_state(network, kept.weights, path)
    chosen = choose_device(device)
    return PoseModel(
        network.to(chosen).eval(),
        made,
        whole_setting(config, "window", MOST_WINDOW, path),
        tuple(artefact.manifest.licences),
        last_sentence(kept.trainings),
        artefact.manifest.digest,
        chosen,
        kept.trainings[-1].minutes if kept.trainings else 0.0,
        kept.trainings[-1].steps if kept.trainings else 0,
    )


def blended(frames: int, window: int, made: Callable[[int, int], BodyPose]) -> BodyPose:
    """The poses (1, T) of a clip of any length from half-overlapping windows, in time linear in its length.

    Args:
        window: frames of a window.
        made: the poses (1, stop - start) of the frames start to stop, in the clip's own frame of reference.
    """
    roots: Tensor | None = None
    turns: Tensor | None = None
    weights = torch.zeros(1, frames, 1)
    for start, stop, fade in overlapping_windows(frames, window):
        pose = made(start, stop)
        if roots is None or turns is None:
            roots = torch.zeros(1, frames, 3)
            turns = torch.zeros(1, frames, *pose.rotations.shape[2:])
        part, fade = slice(start, stop), fade.view(1, -1, 1)
        roots[:, part] += fade * pose.roots
        turns[:, part] += fade.unsqueeze(-1) * aligned_signs(pose.rotations, turns[:, part])
        weights[:, part] += fade
    assert roots is not None and turns is not None
    return BodyPose(roots / weights, unit(turns))
