"""The weights that come with the package: where they lie, and which are the default; what they are: `facts`.

It opens no file, only looks which are there, so that help is printed at once.
"""

from __future__ import annotations

from pathlib import Path

from data_schemas.errors import InputError, UsageError
from stages.shared.weights.fetched import PARTS, fetched_at

SHIPPED = Path(__file__).resolve().parent
# The first of these that is shipped is the default: free for any use before better but non-commercial ones.
PREFERRED = ("small-free", "small")
WITHDRAWN = {"tiny": "small-free"}  # names of older versions, and what takes their place
MEASURED_NAME = "measured.json"
CONFIDENCE_NAME = "confidence.json"  # `stages.shared.inference.confidence`
VARIATION_NAME = "variation.json"  # `stages.shared.inference.variation`
CARD_NAME = "MODEL_CARD.md"


def shipped_weights() -> list[str]:
    """Names of the weights that come with the package."""
    if not SHIPPED.is_dir():
        return []
    return sorted(each.name for each in SHIPPED.iterdir() if (each / "ae" / "manifest.json").is_file())


def default_weights() -> str:
    """The weights that are used where none are named: the first shipped one of `PREFERRED`, else its last name."""
    shipped = shipped_weights()
    return next((name for name in PREFERRED if name in shipped), PREFERRED[-1])


def weights_folder(name_or_path: str | Path) -> Path:
    """The folder with `ae` and `lms` that a name or path means.

    Shipped weights come before fetched ones of the same name.

    Raises: InputError naming the shipped weights, where it means none.
    """
    for folder in (Path(name_or_path), SHIPPED / str(name_or_path), *fetched_at(name_or_path)):
        if any((folder / ae / "manifest.json").is_file() for ae, _ in PARTS):
            return folder
    if (instead := WITHDRAWN.get(str(name_or_path))) is not None:
        raise InputError(
            f"The weights {name_or_path} are no longer shipped, because a licence of their data forbids adaptations.",
            f"Use {instead}, which has the same size.",
        )
    shipped = ", ".join(shipped_weights()) or "none"
    raise InputError(
        f"There are no weights {name_or_path}: neither a folder with ae and lms, nor shipped ({shipped}), nor "
        "fetched.",
        "Give --weights a name of `pumps weights list`, or the run's folder that `pumps train` wrote into.",
    )


def named_source(text: str, flag: str = "--weights") -> tuple[str, str]:
    """`NAME=FOLDER`, or the name of shipped weights, or a folder, which is then called by its last part.

    Returns: the name and the source. Raises UsageError where a part is missing.
    """
    name, equals, source = text.partition("=")
    if not equals:
        return Path(text).name or text, text
    if not name or not source:
        raise UsageError(f"{flag} {text!r} is not NAME=FOLDER.", f"Write for instance {flag} mine=runs/mine.")
    return name, source


def parts_of(folder: Path) -> tuple[Path, Path]:
    """The autoencoder's and the synthesiser's artefacts in a folder of weights."""
    ae, lms = next(names for names in PARTS if (folder / names[0] / "manifest.json").is_file())
    return folder / ae, folder / lms
