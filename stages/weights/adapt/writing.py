"""The folder of adapted weights: both networks, their confidence and variation, and one card."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from data_schemas.artefact import open_artefact
from data_schemas.checkpoint import Checkpoint
from data_schemas.manifest import Artefact
from data_schemas.trainings import last_sentence
from stages.shared.inference.confidence import Confidence, write_confidence
from stages.shared.outputs import write_output
from stages.shared.weights.packing import read_to_pack, write_packed
from stages.shared.weights.shipped import CARD_NAME, CONFIDENCE_NAME, MEASURED_NAME, VARIATION_NAME

STAGE = "weights-adapt"
_PACKED = ("weights-pack", STAGE)  # stages that write autoencoders without places and optimisers


@dataclass(frozen=True)
class Adapted:
    """What is written.

    synthesiser: the checkpoint at the start with the kept weights and their trainings.
    trust: the confidence that was fitted anew; None for that of the start.
    changed: whether anything was learned from the recordings. licences: of these.
    facts: of the adaptation, plain data. lines: the table of the card.
    """

    synthesiser: Checkpoint
    trust: np.ndarray | None
    changed: bool
    licences: Sequence[str]
    facts: dict[str, Any]
    lines: Sequence[str]


def write_weights(folder: Path, name: str, source: Path, ae: Artefact, lms: Artefact, adapted: Adapted) -> None:
    """Write the weights into a new folder.

    Args:
        name: of the weights. source: the folder that the adaptation started from, with the artefacts ae and lms.
    """
    packed = _same_or_packed(folder / "ae", ae)
    licences = sorted({*lms.manifest.licences, *(adapted.licences if adapted.changed else ())})
    card = _card(name, licences, adapted)
    settings = {**adapted.synthesiser.config, "encoder_digest": packed.manifest.digest, "adapted_from": adapted.facts}
    synthesiser = replace(adapted.synthesiser, config=settings, card=card)
    write_packed(folder / "lms", synthesiser, lms, stage=STAGE, licences=licences)
    # A variation is of one autoencoder, by its digest.
    copied = [VARIATION_NAME] if packed.manifest.digest == ae.manifest.digest else []
    if adapted.trust is None:
        copied.append(CONFIDENCE_NAME)
    else:
        about = {"windows": adapted.facts["held_out"]["windows"], "adapted_from": adapted.facts["weights"]}
        write_confidence(folder / CONFIDENCE_NAME, Confidence(adapted.trust), about)
    if not adapted.changed:
        copied.append(MEASURED_NAME)
    for each in copied:
        if (source / each).is_file():
            shutil.copyfile(source / each, folder / each)
    write_output(folder / CARD_NAME, card.encode("utf-8"))


def _same_or_packed(path: Path, ae: Artefact) -> Artefact:
    """The autoencoder as it is where it was packed before, so that what was measured of it holds."""
    if ae.manifest.stage in _PACKED:
        shutil.copytree(ae.path, path)
        return open_artefact(path, "checkpoint")
    return write_packed(path, read_to_pack(ae), ae, stage=STAGE, licences=ae.manifest.licences)


def _card(name: str, licences: Sequence[str], adapted: Adapted) -> str:
    facts = adapted.facts
    held = facts["held_out"]
    fitted = " with the confidence fitted anew" if facts["confidence_fitted"] else ""
    kept = f"{facts['kept']}{fitted} (start: the weights `{facts['weights']}`; mean: of those and the trained ones)"
    if not adapted.changed:
        kept = f"the weights of {facts['weights']} as they were, since no others were better by more than chance"
    return "\n".join(
        [
            f"# The weights `{name}`",
            "",
            f"The weights `{facts['weights']}`, adapted to recordings by `pumps weights adapt`.",
            "",
            f"- Kept: {kept}.",
            f"- Training: {facts['steps']} steps in {facts['minutes']} minutes.",
            f"- Last trained on: {last_sentence(adapted.synthesiser.trainings) or 'not stated'}.",
            "- Licences of the data, which the weights carry, apart from the code's Apache-2.0:",
            *[f"  - {licence}" for licence in licences or ["none stated"]],
            "",
            f"On {held['windows']} windows of held-out recordings, L2P as a share of slerp's. The weights were",
            "chosen on these windows, so other recordings may gain less.",
            "",
            *adapted.lines,
            "",
        ]
    )
