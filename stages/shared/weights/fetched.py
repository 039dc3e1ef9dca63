"""The weights that `pumps weights fetch` keeps in the user's cache: where they lie, and their names."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

PARTS = (("ae", "lms"), ("train-ae", "train-lms"))  # folders of packed weights; of a run


def fetched_folder() -> Path:
    """The folder that keeps fetched weights, each in a folder of its name."""
    import platformdirs  # when it is needed, since help is printed without it

    return platformdirs.user_cache_path("pumps") / "weights"


def fetched_weights() -> list[str]:
    """Names of the fetched weights: those for filling, and networks of one task."""
    folder = fetched_folder()
    return sorted(path.name for path in folder.iterdir() if _is_weights(path)) if folder.is_dir() else []


def fetched_at(name_or_path: str | Path) -> Iterator[Path]:
    """The folder of the fetched weights of a name, where it is a plain name."""
    name = str(name_or_path)
    if name and not name.startswith(".") and not set(name) & set("/\\:"):
        yield fetched_folder() / name


def _is_weights(path: Path) -> bool:
    places = ("", *(ae for ae, _ in PARTS))  # the first: a checkpoint of one task
    return not path.name.startswith(".") and any((path / each / "manifest.json").is_file() for each in places)
