"""The weights that come with the package: where they lie, which serve by default; what they are: `facts`.

Reads no file except for being there, so that help is made at once.
"""

from __future__ import annotations

from pathlib import Path

from data_schemas.errors import InputError

SHIPPED = Path(__file__).resolve().parent
# The first of these that is shipped is the default: free for any use before better but non-commercial ones.
PREFERRED = ("small-free", "small", "tiny")
PARTS = (("ae", "lms"), ("train-ae", "train-lms"))  # of packed weights; of a run
MEASURED_NAME = "measured.json"
CONFIDENCE_NAME = "confidence.json"  # `stages.shared.inference.confidence`
CARD_NAME = "MODEL_CARD.md"


def shipped_weights() -> list[str]:
    """Names of the weights that come with the package."""
    if not SHIPPED.is_dir():
        return []
    return sorted(each.name for each in SHIPPED.iterdir() if (each / "ae" / "manifest.json").is_file())


def default_weights() -> str:
    """The weights that serve where none are named; the last resort's name where none are shipped."""
    shipped = shipped_weights()
    return next((name for name in PREFERRED if name in shipped), PREFERRED[-1])


def weights_folder(name_or_path: str | Path) -> Path:
    """The folder with `ae` and `lms` that a name or path means.

    Raises: InputError naming the shipped weights, where it means none.
    """
    for folder in (Path(name_or_path), SHIPPED / str(name_or_path)):
        if any((folder / ae / "manifest.json").is_file() for ae, _ in PARTS):
            return folder
    shipped = ", ".join(shipped_weights()) or "none"
    raise InputError(
        f"There are no weights {name_or_path}: neither a folder with ae and lms, nor shipped ({shipped}).",
        "Give --weights a shipped name, or the run's folder that `pumps train` wrote into.",
    )


def parts_of(folder: Path) -> tuple[Path, Path]:
    """The autoencoder's and the synthesiser's artefacts in a folder of weights."""
    ae, lms = next(names for names in PARTS if (folder / names[0] / "manifest.json").is_file())
    return folder / ae, folder / lms
