"""The tasks by name. Each task's module is imported only when it is used.

An installed package adds tasks by entry points of the group `pumps.tasks`, such as
`mine = "my_package.my_module:MyTask"`.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import entry_points
from typing import TYPE_CHECKING

from data_schemas.errors import UsageError

if TYPE_CHECKING:
    from stages.shared.pointcloud.rig import Rig
    from stages.shared.pose_tasks.task import PoseTask

ENTRY_POINTS = "pumps.tasks"
TASKS = {
    "denoise": "stages.shared.pose_tasks.denoise:DenoiseTask",
    "repair": "stages.shared.pose_tasks.denoise:RepairTask",
    "estimate": "stages.shared.pose_tasks.estimate:EstimateTask",
    "trackers": "stages.shared.pose_tasks.trackers:TrackersTask",
}


def task_names() -> list[str]:
    """The names that `task_named` knows."""
    return [*TASKS, *(each.name for each in entry_points(group=ENTRY_POINTS) if each.name not in TASKS)]


def task_named(name: str, rig: Rig, corruption: str | None = None) -> PoseTask:
    """The task of this name on a rig, with its first corruption by default.

    Raises: UsageError if there is no such task or corruption.
    """
    place = TASKS.get(name)
    for entry in entry_points(group=ENTRY_POINTS):
        place = place or (entry.value if entry.name == name else None)
    if place is None:
        raise UsageError(f"There is no task {name!r}.", f"Take one of {', '.join(task_names())}.")
    module, _, type_name = place.partition(":")
    return getattr(import_module(module), type_name)(rig, corruption)
