"""The shipped weights that are one network for one task, such as the lifter: a checkpoint each, in a folder of its
name. Opens no file."""

from __future__ import annotations

from pathlib import Path

from data_schemas.errors import InputError
from stages.shared.weights import shipped
from stages.shared.weights.fetched import fetched_at


def shipped_task_weights() -> list[str]:
    """Names of the task networks that come with the package."""
    return sorted(each.parent.name for each in shipped.SHIPPED.glob("*/manifest.json"))


def is_of_task(name_or_path: str | Path) -> bool:
    """Whether a name or path means the weights of one task."""
    return any((folder / "manifest.json").is_file() for folder in _folders(name_or_path))


def task_weights(name_or_path: str | Path) -> Path:
    """The checkpoint's folder that a name or path means.

    Raises: InputError naming the shipped ones, where it means none.
    """
    for folder in _folders(name_or_path):
        if (folder / "manifest.json").is_file():
            return folder
    names = ", ".join(shipped_task_weights()) or "none"
    raise InputError(
        f"There are no weights {name_or_path}: neither a checkpoint's folder, nor shipped ({names}), nor fetched.",
        "Give --weights the folder that `pumps train finetune` wrote into.",
    )


def _folders(name_or_path: str | Path) -> tuple[Path, ...]:
    return (Path(name_or_path), shipped.SHIPPED / str(name_or_path), *fetched_at(name_or_path))
