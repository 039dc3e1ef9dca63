"""The tasks by name. Each task's module is imported only when it is used."""

from __future__ import annotations

from importlib import import_module

from data_schemas.errors import UsageError
from stages.shared.pointcloud.rig import Rig
from stages.shared.pose_tasks.task import PoseTask

TASKS = {
    "denoise": "stages.shared.pose_tasks.denoise:DenoiseTask",
    "repair": "stages.shared.pose_tasks.denoise:RepairTask",
    "estimate": "stages.shared.pose_tasks.estimate:EstimateTask",
    "trackers": "stages.shared.pose_tasks.trackers:TrackersTask",
}


def task_named(name: str, rig: Rig, corruption: str | None = None) -> PoseTask:
    """The task of this name on a rig, with its first corruption by default.

    Raises: UsageError if there is no such task or corruption.
    """
    if name not in TASKS:
        raise UsageError(f"There is no task {name!r}.", f"Take one of {', '.join(TASKS)}.")
    module, _, type_name = TASKS[name].partition(":")
    return getattr(import_module(module), type_name)(rig, corruption)
