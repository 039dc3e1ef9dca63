"""The tasks by name. Each task's module is imported only when it is used.

An installed package adds tasks by entry points of the group `pumps.tasks`, such as
`mine = "my_package.my_module:MyTask"`.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import entry_points

from data_schemas.errors import UsageError
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
    return [*_places()]


def task_named(name: str, rig: Rig, corruption: str | None = None) -> PoseTask:
    """The task of this name on a rig, with its first corruption by default.

    Raises: UsageError if there is no such task or corruption.
    """
    places = _places()
    if name not in places:
        raise UsageError(f"There is no task {name!r}.", f"Take one of {', '.join(places)}.")
    module, _, type_name = places[name].partition(":")
    return getattr(import_module(module), type_name)(rig, corruption)


def _places() -> dict[str, str]:
    """Name -> "module:type". A package cannot replace a task of pumps."""
    others = {each.name: each.value for each in entry_points(group=ENTRY_POINTS) if each.name not in TASKS}
    return {**TASKS, **others}
